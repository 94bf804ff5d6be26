#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/pair.hpp>

#include "base/packed_box.hpp"
#include "base/threads.hpp"
#include "engines/frame.hpp"
#include "opencl/context.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// Those of the pairs whose boxes touch: the lower bound of one is the upper bound of the other on an axis.
/// With reaches, those that are in doubt: base/distance.hpp.
/// @param boxes By slot, packed.
/// @param reaches By slot; none if there are none.
/// @param axes Those that count.
/// @param threads At most; 0 for one per processor.
/// @throws std::bad_alloc
[[nodiscard]] std::vector<Pair> touching_pairs(std::span<const Pair> pairs, std::span<const Aabb> boxes,
                                               std::span<const float> reaches, AxisSet axes,
                                               const Threads& threads);

/// The same for the pairs of a frame on a device: kernels/touching.cl.
class TouchingPairs {
 public:
  /// @param context, profiler Must outlive this object.
  /// @throws cl::Error, Error
  TouchingPairs(const opencl::Context& context, opencl::Profiler& profiler);

  /// Waits for the device.
  /// @param frame Whose search has ended.
  /// @returns In any order.
  /// @throws cl::Error, Error, std::bad_alloc
  [[nodiscard]] std::vector<Pair> find(const Frame& frame, AxisSet axes);

 private:
  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  opencl::SizedKernel kernel_;
  opencl::GrowingBuffer result_;  // the number of pairs so far, and the pairs
  cl_uint counted_ = 0;           // that number
  bool is_counted_ = false;       // it is known
  std::size_t expected_ = 0;      // pairs
};

}  // namespace broadcl
