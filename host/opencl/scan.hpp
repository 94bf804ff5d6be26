#pragma once

#include <cstddef>

#include "opencl/api.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl::opencl {

/// Exclusive prefix sums on the device: kernels/scan.cl, which names the source.
class Scan {
 public:
  /// Allocates all the memory that any scan needs, 64 KiB.
  /// @param context Must outlive this object.
  /// @throws Error, cl::Error
  explicit Scan(const Context& context);

  /// Enqueues the exclusive prefix sum of n uints, modulo 2^32: entry k becomes the sum of the values 0 to
  /// k - 1. Does not wait. Scans by one object must be enqueued one after the other, as by a single thread.
  /// @param values, to At least n uints each; may be the same buffer.
  /// @param n Less than 2^31, otherwise an Error is thrown.
  /// @param stage To which the commands belong; null if to none.
  /// @throws cl::Error
  void enqueue(const cl::Buffer& values, const cl::Buffer& to, std::size_t n,
               Profiler::Scope* stage = nullptr);

 private:
  const Context& context_;
  cl::Kernel sums_, blocks_;
  cl::Buffer block_sums_;
};

}  // namespace broadcl::opencl
