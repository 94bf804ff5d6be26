#include "algorithms/source.hpp"

#include <utility>

#include "opencl/launch.hpp"

namespace broadcl {
Source::Source(const opencl::Context& context)
    : context_(context),
      group_(context.group()),
      gather_(context.kernel(context.program("changes.cl"), "gather_boxes", group_)) {}

void Source::set(cl::Buffer boxes, cl_ulong offset, cl_ulong stride, cl::Buffer filters) {
  boxes_ = std::move(boxes);
  offset_ = offset;
  stride_ = stride;
  filters_ = std::move(filters);
}

void Source::gather(const Generation& to, const cl::Buffer& counts, opencl::Profiler& profiler) const {
  if (to.slots == 0) return;
  opencl::Profiler::Scope stage(profiler, "gather");
  set_arguments(gather_, opencl::set_arguments(gather_, 0, to.slots), to, counts);
  context_.queue().enqueueNDRangeKernel(gather_, cl::NullRange,
                                        cl::NDRange(opencl::round_up(to.slots, group_)), cl::NDRange(group_),
                                        nullptr, stage.event());
}

cl_uint Source::set_arguments(cl::Kernel& kernel, cl_uint first, const Generation& to,
                              const cl::Buffer& counts) const {
  return opencl::set_arguments(kernel, first, boxes_, offset_, stride_, filters_, to.boxes, to.filters,
                               counts);
}

}  // namespace broadcl
