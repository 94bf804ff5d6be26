#pragma once

#include "algorithms/search.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// The caller's boxes and filters on the device, in his layout: kernels/gather.h.
class Source {
 public:
  /// @param context Must outlive this object.
  /// @throws cl::Error, Error
  explicit Source(const opencl::Context& context);

  /// What to gather next.
  /// @param offset Of the first box, in floats.
  /// @param stride From each box to the next, in floats.
  /// @param filters Null if there are none.
  void set(cl::Buffer boxes, cl_ulong offset, cl_ulong stride, cl::Buffer filters);

  /// Enqueues the command that copies the objects.
  /// @param counts Of PairDelta.
  /// @throws cl::Error
  void gather(const Generation& to, const cl::Buffer& counts, opencl::Profiler& profiler) const;
  /// Sets the GATHER_PARAMETERS of a kernel that does so besides, from the given index on; returns the index
  /// after the last of them.
  /// @throws cl::Error
  cl_uint set_arguments(cl::Kernel& kernel, cl_uint first, const Generation& to,
                        const cl::Buffer& counts) const;

 private:
  const opencl::Context& context_;
  std::size_t group_;
  mutable cl::Kernel gather_;
  cl::Buffer boxes_, filters_;
  cl_ulong offset_ = 0;
  cl_ulong stride_ = 0;
};

}  // namespace broadcl
