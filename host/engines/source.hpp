#pragma once

#include "engines/search.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// The caller's boxes and filters on the device, in the caller's layout: kernels/gather.h.
class Source {
 public:
  /// @param context Must outlive this object.
  /// @throws cl::Error, Error
  explicit Source(const opencl::Context& context);

  /// Boxes in a buffer.
  struct Boxes {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl::Buffer buffer{};
    std::size_t count = 0;
    cl_ulong offset = 0;  ///< Of the first box, in floats.
    cl_ulong stride = 0;  ///< From each box to the next, in floats.
  };

  /// What to gather next.
  /// @param second The second of two sets; its buffer is null if there is only one set.
  /// @param filters Null if there are none.
  void set(Boxes boxes, Boxes second, cl::Buffer filters);

  /// The caller's boxes if they are packed, in a single set, and have no filters; otherwise null. Some may be
  /// improper or have bounds that are NaN.
  [[nodiscard]] cl::Buffer packed_boxes() const;
  /// Enqueues the command that copies the objects.
  /// @param counts Of PairDelta.
  /// @throws cl::Error
  void gather(const Generation& to, const cl::Buffer& counts, opencl::Profiler& profiler) const;
  /// Sets the GATHER_PARAMETERS of a kernel that also gathers, from the given index on; returns the index
  /// after the last of them.
  /// @throws cl::Error
  cl_uint set_arguments(cl::Kernel& kernel, cl_uint first, const Generation& to,
                        const cl::Buffer& counts) const;
  /// The same for a kernel whose objects need not be gathered.
  /// @throws cl::Error
  static cl_uint set_no_arguments(cl::Kernel& kernel, cl_uint first, const cl::Buffer& boxes,
                                  const cl::Buffer& filters, const cl::Buffer& counts);

 private:
  const opencl::Context& context_;
  mutable opencl::SizedKernel gather_;
  Boxes boxes_, second_;
  cl::Buffer filters_;
};

}  // namespace broadcl
