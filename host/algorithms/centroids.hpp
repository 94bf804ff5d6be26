#pragma once

#include <cstddef>

#include "opencl/context.hpp"

namespace broadcl {

/// The reduction of boxes to the bounds of their centroids, on the device: kernels/centroids.cl.
class CentroidBounds {
 public:
  /// @param context Must outlive this object.
  /// @throws Error, cl::Error
  explicit CentroidBounds(const opencl::Context& context);

  /// Enqueues the reduction of the first n boxes, six floats each; those without a finite centroid, empty
  /// ones above all, count for nothing. Does not wait.
  /// @throws cl::Error
  void enqueue(const cl::Buffer& boxes, std::size_t n);

  /// Six uints: the least x, y, z, then the greatest, as ordered() of kernels/centroids.h makes them; where
  /// no box counts, the greatest uint and 0. The same buffer for all reductions.
  [[nodiscard]] const cl::Buffer& result() const noexcept { return result_; }

 private:
  const opencl::Context& context_;
  cl::Kernel kernel_;
  cl::Buffer result_;
};

}  // namespace broadcl
