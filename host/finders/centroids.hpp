#pragma once

#include <cstddef>

#include "opencl/context.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// The reduction of boxes to the bounds of their centroids, on the device: kernels/centroids.cl.
class CentroidBounds {
 public:
  /// @param context Must outlive this object.
  explicit CentroidBounds(const opencl::Context& context) : context_(context) {}

  /// Enqueues the reduction of the first n boxes, six floats each; those without a finite centroid, in
  /// particular empty ones, are ignored. Does not wait.
  /// @param kernel centroids.
  /// @param filters If not null, there are separate bounds for each world, and for the objects of all worlds.
  /// @param stage To which the commands belong; null if to none.
  /// @throws cl::Error, Error
  void enqueue(opencl::SizedKernel& kernel, const cl::Buffer& boxes, const cl::Buffer& filters, std::size_t n,
               opencl::Profiler::Scope* stage = nullptr);

  /// For each bucket the maxima of -x, -y, -z, x, y and z, as uints in the encoding of ordered() in
  /// kernels/centroids.h; 0 if no box counts. Valid until the next reduction.
  [[nodiscard]] const cl::Buffer& result() const noexcept { return result_.get(); }
  /// One, or with filters the number that bucket_of_world() of kernels/centroids.h expects.
  [[nodiscard]] cl_uint buckets() const noexcept { return buckets_; }

 private:
  const opencl::Context& context_;
  opencl::GrowingBuffer result_;
  cl_uint buckets_ = 1;
};

}  // namespace broadcl
