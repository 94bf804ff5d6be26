#include "finders/centroids.hpp"

#include <algorithm>
#include <bit>

#include "engines/kernel_layout.hpp"
#include "opencl/launch.hpp"
#include "opencl/quirks.hpp"

namespace broadcl {
namespace {

constexpr std::size_t most_rounds = 4096;  // of a work-item's loop
static_assert(most_rounds < opencl::most_iterations);
constexpr std::size_t groups_per_unit = 8;    // if there are enough boxes
constexpr std::size_t boxes_per_bucket = 32;  // worlds of fewer boxes may as well share one

}  // namespace

void CentroidBounds::enqueue(opencl::SizedKernel& kernel, const cl::Buffer& boxes, const cl::Buffer& filters,
                             std::size_t n, opencl::Profiler::Scope* stage) {
  const bool worlds = filters() != nullptr;
  buckets_ = worlds ? static_cast<cl_uint>(std::bit_ceil(n / boxes_per_bucket + 1)) + 1 : 1;
  const std::size_t words = buckets_ * std::size_t{layout::CENTROID_WORDS};
  result_.reserve(context_, words * sizeof(cl_uint), "bounds of worlds");
  context_.fill(result_.get(), 0, 0, words, opencl::event_of(stage));
  if (n == 0) return;
  const std::size_t useful = std::size_t{context_.device().compute_units} * groups_per_unit;
  const std::size_t groups = std::max(opencl::divide_up(n, kernel.group * most_rounds),
                                      std::min(opencl::divide_up(n, kernel.group), useful));
  opencl::set_arguments(kernel.kernel, 0, static_cast<cl_uint>(n), boxes, filters, buckets_, result_.get());
  kernel.enqueue(context_.queue(), groups * kernel.group, opencl::event_of(stage));
}

}  // namespace broadcl
