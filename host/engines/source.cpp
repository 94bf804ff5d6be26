#include "engines/source.hpp"

#include <utility>

#include <broadcl/aabb.hpp>

#include "opencl/common_program.hpp"
#include "opencl/launch.hpp"

namespace broadcl {

Source::Source(const opencl::Context& context)
    : context_(context), gather_(context.sized_kernel(opencl::common_program(context), "gather_boxes")) {}

void Source::set(Boxes boxes, Boxes second, cl::Buffer filters) {
  boxes_ = std::move(boxes);
  second_ = std::move(second);
  filters_ = std::move(filters);
}

cl::Buffer Source::packed_boxes() const {
  const bool is_packed = boxes_.offset == 0 && boxes_.stride == sizeof(Aabb) / sizeof(float) &&
                         second_.buffer() == nullptr && filters_() == nullptr;
  return is_packed ? boxes_.buffer : cl::Buffer();
}

void Source::gather(const Generation& to, const cl::Buffer& counts, opencl::Profiler& profiler) const {
  if (to.slots == 0) return;
  opencl::Profiler::Scope stage(profiler, "gather");
  set_arguments(gather_.kernel, opencl::set_arguments(gather_.kernel, 0, to.slots), to, counts);
  gather_.enqueue(context_.queue(), to.slots, stage.event());
}

cl_uint Source::set_arguments(cl::Kernel& kernel, cl_uint first, const Generation& to,
                              const cl::Buffer& counts) const {
  return opencl::set_arguments(kernel, first, boxes_.buffer, boxes_.offset, boxes_.stride,
                               static_cast<cl_uint>(boxes_.count), second_.buffer, second_.offset,
                               second_.stride, filters_, to.boxes, to.filters, counts);
}

cl_uint Source::set_no_arguments(cl::Kernel& kernel, cl_uint first, const cl::Buffer& boxes,
                                 const cl::Buffer& filters, const cl::Buffer& counts) {
  const cl::Buffer none;
  return opencl::set_arguments(kernel, first, none, cl_ulong{0}, cl_ulong{0}, cl_uint{0}, none, cl_ulong{0},
                               cl_ulong{0}, none, boxes, filters, counts);
}

}  // namespace broadcl
