#include "engines/world_order.hpp"

#include <bit>

#include "opencl/common_program.hpp"
#include "opencl/launch.hpp"

namespace broadcl {

WorldOrder::WorldOrder(const opencl::Context& context) : context_(context) {
  const cl::Program program = opencl::common_program(context);
  offsets_ = context.sized_kernel(program, "order_offsets");
  keys_ = context.sized_kernel(program, "order_world_keys");
  pick_ = context.sized_kernel(program, "order_pick");
}

void WorldOrder::reserve(std::size_t worlds) {
  if (worlds > 0 && counts_() == nullptr) counts_ = context_.buffer(4 * sizeof(cl_uint));
  for (opencl::GrowingBuffer* offsets : {&added_offsets_, &removed_offsets_}) {
    if (worlds == 0) {
      offsets->clear();
    } else {
      offsets->reserve(context_, (worlds + 2) * sizeof(cl_uint), "offsets of worlds");
    }
  }
}

void WorldOrder::enqueue_offsets(const OrderPlan& plan, opencl::Profiler::Scope& stage) {
  if (plan.worlds == 0) return;
  const Report& report = plan.report;
  opencl::set_arguments(offsets_.kernel, 0, static_cast<cl_uint>(plan.worlds), plan.second_set, report.counts,
                        report.added, report.removed, plan.filters, plan.last_filters, report.added_offsets,
                        report.removed_offsets);
  offsets_.enqueue(context_.queue(), plan.worlds + 2, stage.event());
}

void WorldOrder::sort(const cl::Buffer& pairs, std::size_t n, const cl::Buffer& filters, std::size_t worlds,
                      const cl::Buffer& scratch, opencl::RadixSort& sort, opencl::Profiler::Scope& stage) {
  const cl::CommandQueue& queue = context_.queue();
  const cl::Buffer elements = context_.buffer(n * sizeof(Pair));
  const auto count = static_cast<cl_uint>(n);
  opencl::set_arguments(keys_.kernel, 0, count, static_cast<cl_uint>(worlds), pairs, filters, elements);
  keys_.enqueue(queue, n, stage.event());
  const auto bits = static_cast<unsigned>(std::bit_width(worlds));
  sort.enqueue(elements, scratch, n, {{32, bits}}, &stage);
  opencl::set_arguments(pick_.kernel, 0, count, elements, pairs, scratch);
  pick_.enqueue(queue, n, stage.event());
  queue.enqueueCopyBuffer(scratch, pairs, 0, 0, n * sizeof(Pair), nullptr, stage.event());
}

}  // namespace broadcl
