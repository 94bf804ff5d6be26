#pragma once

#include <cstddef>
#include <limits>

#include "base/back_off.hpp"
#include "base/non_copyable.hpp"
#include "engines/pair_delta.hpp"
#include "engines/search.hpp"
#include "opencl/context.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/launch.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// Lets a finder search before the boxes of a frame are uploaded: kernels/near_pairs.cl. In a queue of its
/// own, the finder searches the boxes of the last frame, enlarged by a margin; when the new boxes are there,
/// only the near pairs that it found are tested. The margin follows from how far boxes moved in the last
/// frame. If a box moves farther, the frame is searched again, without this.
class NearPairs : NonCopyable {
 public:
  /// @param context Must outlive this object. If it cannot provide what this needs, nothing is searched
  /// early.
  /// @param program With the kernels of kernels/near_pairs.cl.
  /// @param fewest With fewer boxes, nothing is searched early. The largest number: nothing ever is.
  NearPairs(const opencl::Context& context, cl::Program program, std::size_t fewest)
      : context_(context), program_(std::move(program)), fewest_(fewest) {}
  ~NearPairs() { wait(); }

  /// Starts a frame, whose boxes may still be uploaded in the context's queue.
  /// @param can_search Whether the finder can do without these boxes.
  /// @param pays Whether the last early search saved time.
  /// @returns Whether to search early: then the finder enqueues its kernels in queue(), and calls searched().
  /// (Not if there is too little memory for that.)
  /// @throws cl::Error
  [[nodiscard]] bool begin(const Search& search, const PairDelta& sink, bool can_search, bool pays,
                           opencl::Profiler& profiler);
  [[nodiscard]] const cl::CommandQueue& queue() const noexcept { return queue_; }
  /// The boxes to search.
  [[nodiscard]] const cl::Buffer& boxes() const noexcept { return grown_.get(); }
  /// Sets the PAIR_SINK_PARAMETERS of the kernel that searches early, from the given index on.
  /// @throws cl::Error
  void set_sink(cl::Kernel& kernel, cl_uint first, const Search& search) const;
  /// @throws cl::Error
  void searched();
  /// Makes what is enqueued to the context's queue from now on wait for the early search.
  /// @throws cl::Error
  void await_search();

  /// Enqueues the kernel that appends the new pairs, if the search was early, and that finds out how far
  /// boxes move, if the next frame may be searched early.
  /// @throws cl::Error
  void test(const Search& search, const PairDelta& sink, opencl::Profiler& profiler);
  /// Whether the search was early, and in vain: a box moved farther than by the margin, or there was no room
  /// for all near pairs. The frame must then be searched again, after pause(). Must be called once the counts
  /// of an early search are known.
  /// @param finder_gave_up Because all boxes were near each other.
  [[nodiscard]] bool missed(const PairDelta::Counts& counts, bool finder_gave_up) noexcept;
  /// Pauses early searches for some frames, the longer the more often that happens, and frees their memory.
  void pause();

 private:
  enum class State {
    off,        ///< Nothing.
    measured,   ///< The distances that boxes move.
    searching,  ///< They were measured after an early search, which may not have ended.
    searched,   ///< The same, and it has ended.
  };

  /// What is done in the frame that is begun, or was in the last one.
  struct Plan {
    State state = State::off;
    std::size_t frame = 0;   ///< Its number.
    cl_mem boxes = nullptr;  ///< Those of this frame.
    float margin = 0;        ///< By which the last ones are enlarged.
  };

  [[nodiscard]] bool load();
  [[nodiscard]] bool is_possible(const Search& search) const noexcept;
  [[nodiscard]] bool is_distance_known(const Search& search, const PairDelta& sink, bool pays);
  [[nodiscard]] bool is_early() const noexcept;
  [[nodiscard]] bool reserve(std::size_t slots, std::size_t pairs, opencl::Profiler& profiler);
  [[nodiscard]] cl_uint capacity() const noexcept;
  void wait() const noexcept;

  const opencl::Context& context_;
  cl::Program program_;
  std::size_t fewest_;
  opencl::SizedKernel grow_, test_;
  cl::CommandQueue queue_;
  cl::Event searched_;
  opencl::GrowingBuffer grown_;  // boxes
  opencl::GrowingBuffer pairs_;
  std::size_t wanted_ = 0;  // near pairs to make room for, if that many are useful
  cl::Buffer counts_;       // as those of PairDelta
  Plan plan_;
  /// A margin with which all boxes would be near each other, as long as objects do not come or go.
  float margin_limit_ = std::numeric_limits<float>::infinity();
  BackOff back_off_{256};
};

}  // namespace broadcl
