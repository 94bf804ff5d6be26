#include "engines/order.hpp"

#include <algorithm>
#include <bit>
#include <utility>

#include "engines/kernel_arguments.hpp"
#include "opencl/common_program.hpp"
#include "opencl/direct_memory.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

constexpr std::string_view what = "changes of overlapping pairs";

}  // namespace

Order::Order(const opencl::Context& context, opencl::Profiler& profiler, Frames& frames, Target target)
    : context_(context),
      profiler_(profiler),
      frames_(frames),
      target_(target),
      sort_(context),
      scan_(context),
      by_world_(context) {
  const cl::Program program = opencl::common_program(context);
  small_ = context.kernel(program, "order_small", context.launch().group);
  count_ = context.sized_kernel(program, "order_count");
  scatter_ = context.sized_kernel(program, "order_scatter");
  place_ = context.sized_kernel(program, "order_place");
  renumber_ = context.sized_kernel(program, "order_renumber");
}

/// (Each slot has its own bucket if nobody would sort the changes of one that is too large.)
void Order::plan_buckets() {
  plan_.set_buckets(history_.was_bucket_too_large() || !plan_.is_awaited);
  reserve_buckets(2 * plan_.buckets);
}

void Order::reserve_buckets(std::size_t count) {
  const std::size_t bytes = count * sizeof(cl_uint);
  buckets_.reserve(context_, bytes, what);
  if (bytes <= bucket_counts_.bytes()) return;
  zeros_ = 0;
  bucket_counts_.reserve(context_, bytes, what);
}

void Order::begin(const Search& search) {
  plan_ = OrderPlan(search);  // without a report, so that lists that grow do not exist twice
  plan_.by_buckets = plan_.worlds > 0 || history_.expects_more_than(context_.launch().max_order_small);
  const std::size_t most = (context_.device().max_allocation - PairDelta::count_bytes) / sizeof(Pair);
  history_.set_capacity(plan_, context_.launch().max_order_small, most);
  reserve_result(plan_.capacity);
  if (plan_.by_buckets) {
    plan_buckets();
    scattered_.reserve(context_, plan_.capacity * sizeof(Pair), what);
  }
  by_world_.reserve(plan_.worlds);
  report_to_own_lists();
}

/// Changes for the host are in the same buffer as the counts, so they need no lists.
void Order::report_to_own_lists() {
  if (target_ == Target::host) return;
  plan_.report = {.added = added(),
                  .removed = removed(),
                  .counts = plan_.worlds > 0 ? by_world_.counts() : cl::Buffer(),
                  .capacity = plan_.list_capacity,
                  .added_offsets = added_offsets(),
                  .removed_offsets = removed_offsets()};
}

void Order::begin(const Search& search, const Report& report) {
  constexpr std::size_t most_changes = (std::size_t{1} << 31) - 1;
  plan_ = OrderPlan(search);
  plan_.report = report;
  plan_.is_awaited = false;
  plan_.list_capacity = std::min(report.capacity, most_changes);
  plan_.by_buckets = plan_.worlds > 0 || plan_.list_capacity > context_.launch().max_order_small;
  plan_.capacity = std::min(2 * plan_.list_capacity, scattered_.bytes() / sizeof(Pair));
  if (plan_.by_buckets) plan_buckets();
}

void Order::reserve_ahead(std::size_t slots, std::size_t pairs) {
  reserve_buckets(2 * (slots + 1));
  scattered_.reserve(context_, 2 * std::max(OrderPlan::least_changes, pairs) * sizeof(Pair), what);
}

void Order::reserve_result(std::size_t changes) {
  std::size_t bytes = PairDelta::count_bytes;
  if (target_ == Target::host) {
    bytes += changes * sizeof(Pair);
  } else {
    added_.reserve(context_, changes * sizeof(Pair), what);
    removed_.reserve(context_, changes * sizeof(Pair), what);
  }
  Frame::Result& result = frames_.now.result;
  result.is_small = bytes <= opencl::most_direct && context_.has_direct_memory();
  opencl::SharedBuffer& buffer = result.get();
  if (buffer.bytes() >= bytes && !buffer.is_kept()) return;
  buffer = {};
  buffer = result.is_small ? opencl::SharedBuffer(context_, opencl::most_direct, true)
                           : opencl::SharedBuffer(context_, opencl::grown(context_, bytes, what));
}

/// Sets a kernel's CHANGES_PARAMETERS, its first ones; returns the index after the last of them.
cl_uint Order::set_changes(cl::Kernel& kernel, const PairDelta& delta, cl_uint tag) const {
  return opencl::set_arguments(
      kernel, 0,
      layout::order_scalars_t{.capacity = static_cast<cl_uint>(frames_.now.pairs.capacity),
                              .list_capacity = static_cast<cl_uint>(plan_.list_capacity),
                              .total_capacity = static_cast<cl_uint>(plan_.capacity),
                              .tag = tag,
                              .buckets_of_list = static_cast<cl_uint>(plan_.buckets),
                              .bucket_bits = plan_.bucket_bits,
                              .worlds = static_cast<cl_uint>(plan_.worlds),
                              .second_set = plan_.second_set},
      frames_.now.pairs.buffer.get(), delta.removed(), frames_.now.counts);
}

/// Sets a kernel's RESULT_PARAMETERS, its last ones.
void Order::set_results(cl::Kernel& kernel, cl_uint first) {
  opencl::set_arguments(kernel, first, frames_.last.counts,
                        plan_.is_awaited ? result().device() : cl::Buffer(), plan_.report.counts,
                        plan_.report.added, plan_.report.removed);
}

/// @param event Is set to that of the last kernel, unless it is null.
void Order::sort_in_one_launch(const PairDelta& delta, cl_uint tag, cl::Event* event) {
  const std::size_t group = context_.launch().group;
  set_results(small_, set_changes(small_, delta, tag));
  const std::size_t groups =
      opencl::divide_up(std::max<std::size_t>(plan_.list_capacity, 1), layout::ORDER_RANGE);
  context_.queue().enqueueNDRangeKernel(small_, cl::NullRange, cl::NDRange(groups * group, 2),
                                        cl::NDRange(group, 1), nullptr, event);
}

/// @param event As above.
/// @param stage To which the other kernels belong.
void Order::sort_by_buckets(const PairDelta& delta, cl_uint tag, cl::Event* event,
                            opencl::Profiler::Scope& stage) {
  const std::size_t buckets = 2 * plan_.buckets;
  if (zeros_ < buckets) context_.fill(bucket_counts_.get(), 0, 0, buckets, stage.event());
  const std::size_t zeros = std::max(buckets, std::exchange(zeros_, 0));
  // Each work-item handles several changes, but not so many that it exceeds opencl::most_iterations.
  const std::size_t most_items = std::max(std::size_t{1} << 20, plan_.capacity / 8);
  const std::size_t items = std::clamp(
      plan_.capacity, std::min(most_items, context_.device().compute_units * std::size_t{64}), most_items);
  for (opencl::SizedKernel* sized : {&count_, &scatter_, &place_}) {
    cl::Kernel& kernel = sized->kernel;
    const cl_uint next = opencl::set_arguments(kernel, set_changes(kernel, delta, tag),
                                               sized == &count_ ? bucket_counts_.get() : buckets_.get(),
                                               scattered_.get(), plan_.filters, plan_.last_filters);
    if (sized == &place_) {
      kernel.setArg(next, bucket_counts_.get());
      set_results(kernel, next + 1);
    }
    sized->enqueue(context_.queue(), items, sized == &place_ ? event : stage.event());
    if (sized == &count_) scan_.enqueue(bucket_counts_.get(), buckets_.get(), buckets, &stage);
  }
  zeros_ = zeros;
}

void Order::read(std::size_t changes) {
  if (result().is_direct()) return;
  opencl::Profiler::Scope stage(profiler_, "download");
  const std::size_t bytes = target_ == Target::host ? changes * sizeof(Pair) : 0;
  result().download(PairDelta::count_bytes + bytes, &ready_);
  if (cl::Event* const event = stage.event()) *event = ready_;
}

void Order::enqueue(const PairDelta& delta, cl_uint tag) {
  if (plan_.is_awaited) result().release();
  {
    opencl::Profiler::Scope stage(profiler_, "order");
    cl::Event* const own = stage.event();
    // Whether it is the last command before the host may read.
    const bool is_last = plan_.is_awaited && result().is_direct() && target_ == Target::device;
    cl::Event* const event = is_last ? &ready_ : own;
    plan_.by_buckets ? sort_by_buckets(delta, tag, event, stage) : sort_in_one_launch(delta, tag, event);
    if (is_last && own != nullptr) *own = ready_;
    by_world_.enqueue_offsets(plan_, stage);
  }
  if (plan_.is_awaited) read(plan_.expected);
}

void Order::renumber(const cl::Buffer& pairs, std::size_t n, cl_uint second_set, cl::Event* event) {
  if (second_set == 0) return;
  opencl::set_arguments(renumber_.kernel, 0, static_cast<cl_uint>(n), second_set, pairs);
  renumber_.enqueue(context_.queue(), n, event);
}

PairDelta::Counts Order::wait(const PairDelta& delta) {
  const opencl::Profiler::Scope stage(profiler_, "wait");
  if (result().is_direct() && target_ == Target::host) {
    context_.queue().finish();  // which takes less time than waiting for an event
  } else {
    ready_.wait();
  }
  return delta.counts_of(result().host());
}

bool Order::complete(const PairDelta& delta, const PairDelta::Counts& counts) {
  const std::size_t changes = counts.added + counts.removed;
  const bool is_ordered = plan_.fits(counts);
  if (counts.is_unordered) history_.bucket_was_too_large();
  if (!is_ordered) sort_changes(delta, counts);
  if (target_ == Target::host && (!is_ordered || changes > plan_.expected)) {
    read(changes);
    (void)wait(delta);
  }
  return is_ordered;
}

void Order::sort_changes(const PairDelta& delta, const PairDelta::Counts& counts) {
  opencl::Profiler::Scope stage(profiler_, "sort");
  const cl::CommandQueue& queue = context_.queue();
  const auto sort_list = [&](opencl::GrowingBuffer& to, const cl::Buffer& from, std::size_t first,
                             std::size_t n, const cl::Buffer& filters) {
    to.reserve(context_, n * sizeof(Pair), what);
    if (n == 0) return;
    queue.enqueueCopyBuffer(from, to.get(), first * sizeof(Pair), 0, n * sizeof(Pair), nullptr,
                            stage.event());
    scattered_.reserve(context_, n * sizeof(Pair), what);
    sort(to.get(), n, plan_.slots, scattered_.get(), &stage);
    if (plan_.worlds > 0) by_world_.sort(to.get(), n, filters, plan_.worlds, scattered_.get(), sort_, stage);
    renumber(to.get(), n, plan_.second_set, stage.event());
  };
  plan_.report = {};  // lists that grow do not exist twice
  const Frame::PairList& pairs = frames_.now.pairs;
  sort_list(added_, pairs.buffer.get(), pairs.capacity - counts.added, counts.added, plan_.filters);
  sort_list(removed_, delta.removed(), 0, counts.removed, plan_.last_filters);
  report_to_own_lists();
  if (plan_.worlds > 0) {
    context_.fill(plan_.report.counts, static_cast<cl_uint>(counts.added), 0, 1, stage.event());
    context_.fill(plan_.report.counts, static_cast<cl_uint>(counts.removed), 1, 1, stage.event());
    by_world_.enqueue_offsets(plan_, stage);
  }
  if (target_ == Target::device) return;
  reserve_result(counts.added + counts.removed);
  result().release();
  std::size_t offset = PairDelta::count_bytes;
  for (const auto& [list, n] : {std::pair(added_.get(), counts.added), {removed_.get(), counts.removed}}) {
    if (n > 0) {
      queue.enqueueCopyBuffer(list, result().device(), 0, offset, n * sizeof(Pair), nullptr, stage.event());
    }
    offset += n * sizeof(Pair);
  }
  added_.clear();
  removed_.clear();
}

Delta Order::on_host(const PairDelta::Counts& counts) const noexcept {
  const opencl::SharedBuffer& buffer = frames_.last.result.get();
  const auto* changes = reinterpret_cast<const Pair*>(buffer.host() + PairDelta::count_bytes);
  return {{changes, counts.added}, {changes + counts.added, counts.removed}, buffer.owner()};
}

void Order::sort(const cl::Buffer& pairs, std::size_t n, std::size_t slots, const cl::Buffer& scratch,
                 opencl::Profiler::Scope* stage) {
  const auto bits = static_cast<unsigned>(std::bit_width(slots));
  sort_.enqueue(pairs, scratch, n, {{layout::PAIR_FIRST_BIT, bits}, {layout::PAIR_SECOND_BIT, bits}}, stage);
}

}  // namespace broadcl
