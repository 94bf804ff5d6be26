#pragma once

#include <cstddef>

#include "opencl/api.hpp"
#include "opencl/context.hpp"

namespace broadcl::opencl {

/// Exclusive prefix sums on the device: kernels/scan.cl, which names the source.
class Scan {
 public:
  /// Allocates all that any scan will need, 64 KiB.
  /// @param context Must outlive this object.
  /// @throws Error, cl::Error
  explicit Scan(const Context& context);

  /// Enqueues the exclusive prefix sum of n uints, in place, modulo 2^32: value k becomes the sum of the
  /// values 0 to k - 1. Does not wait. Scans of one object must go to the queue one after the other, as those
  /// of one thread do.
  /// @param values Of at least n uints.
  /// @param n Less than 2^31.
  /// @throws cl::Error
  void enqueue(const cl::Buffer& values, std::size_t n);

 private:
  const Context& context_;
  cl::Kernel sums_, blocks_;
  cl::Buffer block_sums_;
};

}  // namespace broadcl::opencl
