#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <broadcl/pair.hpp>

#include "opencl/context.hpp"
#include "opencl/profiler.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {

/// Turns the pairs that a kernel finds in each frame into what changed since the last, on the device:
/// kernels/delta.cl.
///
/// Algorithms that find pairs in a list share it. The list lies on the device and grows as needed: no pair is
/// dropped.
class PairDelta {
 public:
  /// Where a kernel appends pairs: see kernels/pair_list.h.
  struct List {
    cl_uint capacity;
    cl::Buffer pairs;
    cl::Buffer counts;
  };

  /// @param context, profiler Must outlive this object.
  PairDelta(const opencl::Context& context, opencl::Profiler& profiler);

  /// Runs a frame. Waits for the device once; again only where the list was too small or many pairs changed.
  /// @param slots Number of slots.
  /// @param renewed Slots whose object is another one than in the last frame, ascending.
  /// @param find Enqueues what appends every pair to a list; called again with a larger one where it did not
  /// fit.
  /// @throws cl::Error, Error; the pairs of the last frame are then still known.
  Delta update(std::size_t slots, std::span<const std::uint32_t> renewed, const std::function<void()>& find);

  /// Sets a kernel's PAIR_SINK_PARAMETERS, from the given index on.
  void set_sink(cl::Kernel& kernel, cl_uint first) const;

  /// All pairs of the last frame.
  [[nodiscard]] std::vector<Pair> pairs() const;

 private:
  /// The pairs of a frame, and a hash table of them.
  struct Frame {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl_uint capacity = 0;
    cl_uint mask = 0;  // entries of the table less one
    cl_uint found = 0;
    cl::Buffer pairs;
    cl::Buffer table;
    cl::Buffer kept;  // a byte a pair
  };

  [[nodiscard]] Frame make_frame(std::size_t capacity) const;
  [[nodiscard]] cl::Buffer zeros(std::size_t bytes) const;
  void reserve(std::size_t capacity);
  void upload_renewed(std::size_t slots, std::span<const std::uint32_t> renewed);
  void enqueue_delta(std::size_t ordered);
  /// Brings the counts and the first changes to the host, and waits.
  void read_result(std::size_t changes);
  [[nodiscard]] const cl_uint* counts() const;
  [[nodiscard]] std::span<Pair> changes(std::size_t total) const;

  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  cl::Kernel sweep_, order_;
  Frame frame_, last_;
  std::array<cl::Buffer, 2> counts_;  // of this frame and of the next, in turn
  std::size_t turn_ = 0;
  cl::Buffer added_, removed_;
  opencl::SharedBuffer result_;  // counts, added, removed
  opencl::SharedBuffer renewed_;
  cl_uint any_renewed_ = 0;
  std::size_t expected_changes_ = 0;  // as many as in the last frame
  std::size_t longest_list_ = 0;      // the longer of added and removed in the last frame
};

}  // namespace broadcl
