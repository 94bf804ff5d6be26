#pragma once

#include <cstddef>

#include "engines/order_plan.hpp"
#include "opencl/context.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/profiler.hpp"
#include "opencl/radix_sort.hpp"

namespace broadcl {

/// Changes that are ordered by world, and canonically within a world: where worlds begin in the lists, and a
/// sort for lists that the buckets of kernels/order_buckets.cl did not order.
class WorldOrder {
 public:
  /// @param context Must outlive this object.
  /// @throws cl::Error, Error
  explicit WorldOrder(const opencl::Context& context);

  /// Reserves memory for the offsets of this many worlds, or frees it if there are none.
  /// @throws cl::Error, Error
  void reserve(std::size_t worlds);
  [[nodiscard]] const cl::Buffer& added_offsets() const noexcept { return added_offsets_.get(); }
  [[nodiscard]] const cl::Buffer& removed_offsets() const noexcept { return removed_offsets_.get(); }
  /// A report's counts, for frames whose caller gives no buffer for them.
  [[nodiscard]] const cl::Buffer& counts() const noexcept { return counts_; }

  /// Enqueues the command that writes the offsets of the report, if changes are ordered by world.
  /// @throws cl::Error
  void enqueue_offsets(const OrderPlan& plan, opencl::Profiler::Scope& stage);

  /// Enqueues the commands that sort a list that is in canonical order.
  /// @param filters Of the frame in which these were pairs.
  /// @param scratch As large as `pairs`; overwritten.
  /// @throws cl::Error, Error
  void sort(const cl::Buffer& pairs, std::size_t n, const cl::Buffer& filters, std::size_t worlds,
            const cl::Buffer& scratch, opencl::RadixSort& sort, opencl::Profiler::Scope& stage);

 private:
  const opencl::Context& context_;
  opencl::SizedKernel offsets_, keys_, pick_;
  opencl::GrowingBuffer added_offsets_, removed_offsets_;
  cl::Buffer counts_;  // null until there are worlds
};

}  // namespace broadcl
