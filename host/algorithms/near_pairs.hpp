#pragma once

#include <cstddef>
#include <limits>

#include "algorithms/pair_delta.hpp"
#include "algorithms/search.hpp"
#include "opencl/context.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/launch.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// Lets a finder search before the boxes of a frame are uploaded: kernels/near_pairs.cl. In a queue of its
/// own, the finder searches the boxes of the last frame, enlarged by a margin; when the new boxes are there,
/// only the near pairs that it found are tested. The margin follows from how far boxes moved in the last
/// frame. If a box moves farther, the frame is searched again, without this.
class NearPairs {
 public:
  /// @param context Must outlive this object. If it cannot provide what this needs, nothing is searched
  /// early.
  /// @param fewest With fewer boxes, nothing is searched early. The largest number: nothing ever is.
  NearPairs(const opencl::Context& context, std::size_t fewest) : context_(context), fewest_(fewest) {}
  ~NearPairs() { wait(); }
  NearPairs(const NearPairs&) = delete;
  NearPairs& operator=(const NearPairs&) = delete;
  NearPairs(NearPairs&&) = delete;
  NearPairs& operator=(NearPairs&&) = delete;

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

  /// Enqueues the kernel that appends the new pairs, if the search was early, and that finds out how far
  /// boxes move, if the next frame may be searched early.
  /// @throws cl::Error
  void test(const Search& search, const PairDelta& sink, opencl::Profiler& profiler);
  /// Whether the search was early, and in vain: a box moved farther than by the margin, or there was no room
  /// for all near pairs. The frame must then be searched again, after give_up(). Must be called once the
  /// counts of an early search are known.
  /// @param hopeless Whether the finder gave up the search, because all boxes were near each other.
  [[nodiscard]] bool missed(const PairDelta::Counts& counts, bool hopeless) noexcept;
  /// Pauses early searches for some frames, the longer the more often that happens, and frees their memory.
  void give_up();

 private:
  [[nodiscard]] bool load();
  [[nodiscard]] bool is_possible(const Search& search) const noexcept;
  [[nodiscard]] bool reserve(std::size_t slots, std::size_t pairs, opencl::Profiler& profiler);
  [[nodiscard]] cl_uint capacity() const noexcept;
  void wait() const noexcept;

  const opencl::Context& context_;
  std::size_t fewest_;
  opencl::SizedKernel grow_, test_;
  cl::CommandQueue queue_;
  cl::Event searched_;
  opencl::GrowingBuffer grown_;  // boxes
  opencl::GrowingBuffer pairs_;
  std::size_t wanted_ = 0;  // near pairs to make room for, if that many are useful
  cl::Buffer counts_;       // as those of PairDelta
  std::size_t frame_ = 0;   // the number of this frame
  cl_mem now_ = nullptr;    // its boxes
  float margin_ = 0;
  /// From this margin on, a search would be in vain, as long as objects do not come or go; not a finite
  /// number if none is known.
  float hopeless_margin_ = std::numeric_limits<float>::infinity();
  bool is_early_ = false;     // whether this frame is searched early
  bool is_measured_ = false;  // whether the distances of this frame will be known
  bool is_running_ = false;   // whether the last early search may not have ended
  std::size_t pause_ = 0;     // frames before the next early search
  std::size_t resume_ = 0;    // the frame of that search
};

}  // namespace broadcl
