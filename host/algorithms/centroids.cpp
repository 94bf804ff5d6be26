#include "algorithms/centroids.hpp"

#include <algorithm>

#include "opencl/launch.hpp"

namespace broadcl {
namespace {

constexpr std::size_t group = 64;
constexpr std::size_t most_rounds = 4096;          // of a work-item's loop: llvmpipe ends it after 65,535
constexpr std::size_t groups_per_unit = 8;         // as far as there are boxes for them
constexpr std::size_t half = 3 * sizeof(cl_uint);  // of the result: minima, maxima

}  // namespace

CentroidBounds::CentroidBounds(const opencl::Context& context) : context_(context) {
  kernel_ = cl::Kernel(context.program("centroids.cl"), "centroids");
  result_ = context.buffer(2 * half);
}

void CentroidBounds::enqueue(const cl::Buffer& boxes, std::size_t n) {
  const cl::CommandQueue& queue = context_.queue();
  queue.enqueueFillBuffer(result_, ~cl_uint{0}, 0, half);
  queue.enqueueFillBuffer(result_, cl_uint{0}, half, half);
  if (n == 0) return;
  const std::size_t useful = std::size_t{context_.device().compute_units} * groups_per_unit;
  const std::size_t groups =
      std::max(opencl::divide_up(n, group * most_rounds), std::min(opencl::divide_up(n, group), useful));
  opencl::set_arguments(kernel_, 0, static_cast<cl_uint>(n), boxes, result_);
  queue.enqueueNDRangeKernel(kernel_, cl::NullRange, cl::NDRange(groups * group), cl::NDRange(group));
}

}  // namespace broadcl
