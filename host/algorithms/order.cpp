#include "algorithms/order.hpp"

#include <algorithm>
#include <bit>
#include <utility>

#include "algorithms/engine_program.hpp"
#include "algorithms/kernel_arguments.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

/// The least number of changes to read with the counts, and the least capacity for them.
constexpr std::size_t least_changes = 512;

/// The largest result that kernels write to direct memory, in bytes: more than few changes take.
constexpr std::size_t small_result = 256 << 10;

/// Up to this many changes per list are sorted in one launch.
std::size_t most_few(const opencl::Context& context) {
  return context.tuning() == opencl::Tuning::cpu ? 256 : 8192;
}

constexpr std::string_view what = "changes of overlapping pairs";

}  // namespace

Order::Order(const opencl::Context& context, opencl::Profiler& profiler, Frames& frames, Target target)
    : context_(context),
      profiler_(profiler),
      frames_(frames),
      target_(target),
      few_(most_few(context)),
      sort_(context),
      scan_(context) {
  const cl::Program program = engine_program(context);
  few_kernel_ = context.kernel(program, "order_small", engine_launch(context).group);
  count_ = context.sized_kernel(program, "order_count");
  scatter_ = context.sized_kernel(program, "order_scatter");
  place_ = context.sized_kernel(program, "order_place");
  offsets_ = context.sized_kernel(program, "order_offsets");
  world_keys_ = context.sized_kernel(program, "order_world_keys");
  renumber_ = context.sized_kernel(program, "order_renumber");
  pick_ = context.sized_kernel(program, "order_pick");
}

void Order::set_search(const Search& search) {
  slots_ = std::max<std::size_t>({1, search.last.slots, search.now.slots});
  worlds_ = search.ordered_worlds;
  second_set_ = search.second_set;
  filters_ = search.now.filters;
  last_filters_ = search.last.filters;
}

/// Sets the number of buckets: one per world, and one for pairs of no such world; or about as many as
/// changes, so that there is little to clear and to add up. But each slot has its own if a bucket was too
/// large before, or if nobody would sort the changes then.
void Order::set_buckets() {
  const std::size_t slots_per_change = 2 * slots_ / std::max<std::size_t>(1, capacity_);
  const bool is_shared = is_awaited_ && !was_bucket_too_large_ && slots_per_change > 0;
  bucket_bits_ = is_shared ? static_cast<cl_uint>(std::bit_width(slots_per_change) - 1) : 0;
  buckets_of_list_ = worlds_ == 0 ? ((slots_ - 1) >> bucket_bits_) + 1 : worlds_ + 1;
  reserve_buckets(2 * buckets_of_list_);
}

void Order::reserve_buckets(std::size_t count) {
  const std::size_t bytes = count * sizeof(cl_uint);
  buckets_.reserve(context_, bytes, what);
  if (bytes <= bucket_counts_.bytes()) return;
  zeros_ = 0;
  bucket_counts_.reserve(context_, bytes, what);
}

void Order::begin(const Search& search) {
  set_search(search);
  // Expect many changes, and allocate more, only if there were many twice in a row: a first frame finds all
  // pairs, the next one only what changed.
  many_ = std::min(last_longest_, longest_before_) > few_ || worlds_ > 0;
  const std::size_t wanted = many_ ? last_changes_ + last_changes_ / 4 : 3 * std::min(last_longest_, few_);
  const std::size_t most = (context_.device().max_allocation - PairDelta::count_bytes) / sizeof(Pair);
  capacity_ = std::max(least_changes, std::min(wanted, std::max(last_wanted_, allocated())));
  capacity_ = std::min(capacity_, most);
  last_wanted_ = wanted;
  expected_ = std::clamp(last_changes_ + last_changes_ / 8, least_changes, capacity_);
  room_ = many_ ? capacity_ : capacity_ / 2;
  report_ = {};  // lists that grow do not exist twice
  is_awaited_ = true;
  reserve_result(capacity_);
  if (many_) {
    set_buckets();
    scattered_.reserve(context_, capacity_ * sizeof(Pair), what);
  }
  for (opencl::GrowingBuffer* offsets : {&added_offsets_, &removed_offsets_}) {
    if (worlds_ == 0) {
      offsets->clear();
    } else {
      offsets->reserve(context_, (worlds_ + 2) * sizeof(cl_uint), what);
    }
  }
  report_to_own_lists();
}

/// Changes for the host are in the same buffer as the counts, so they need no lists.
void Order::report_to_own_lists() {
  if (target_ == Target::host) return;
  report_ = {.added = added(),
             .removed = removed(),
             .capacity = room_,
             .added_offsets = added_offsets(),
             .removed_offsets = removed_offsets()};
}

void Order::begin(const Search& search, const Report& report) {
  set_search(search);
  report_ = report;
  is_awaited_ = false;
  constexpr std::size_t most_changes = (std::size_t{1} << 31) - 1;
  room_ = std::min(report.capacity, most_changes);
  many_ = room_ > few_ || worlds_ > 0;
  capacity_ = std::min(2 * room_, scattered_.bytes() / sizeof(Pair));
  if (many_) set_buckets();
}

void Order::reserve_ahead(std::size_t slots, std::size_t pairs) {
  reserve_buckets(2 * (slots + 1));
  scattered_.reserve(context_, 2 * std::max(least_changes, pairs) * sizeof(Pair), what);
}

/// Changes that there is memory for already.
std::size_t Order::allocated() const noexcept {
  const std::size_t bytes =
      target_ == Target::device
          ? std::min(added_.bytes(), removed_.bytes())
          : std::max(frames_.now.result.large.bytes(), PairDelta::count_bytes) - PairDelta::count_bytes;
  return bytes / sizeof(Pair);
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
  result.is_small = bytes <= small_result && context_.has_direct_memory();
  opencl::SharedBuffer& buffer = result.get();
  if (buffer.bytes() >= bytes && !buffer.is_kept()) return;
  buffer = {};
  buffer = result.is_small ? opencl::SharedBuffer(context_, small_result, true)
                           : opencl::SharedBuffer(context_, opencl::grown(context_, bytes, what));
}

/// Sets a kernel's CHANGES_PARAMETERS, its first ones; returns the index after the last of them.
cl_uint Order::set_changes(cl::Kernel& kernel, const PairDelta& delta, cl_uint tag) const {
  return opencl::set_arguments(
      kernel, 0,
      layout::order_scalars_t{.capacity = static_cast<cl_uint>(delta.list_capacity()),
                              .list_capacity = static_cast<cl_uint>(room_),
                              .total_capacity = static_cast<cl_uint>(capacity_),
                              .tag = tag,
                              .buckets_of_list = static_cast<cl_uint>(buckets_of_list_),
                              .bucket_bits = bucket_bits_,
                              .worlds = static_cast<cl_uint>(worlds_)},
      delta.list(), delta.removed(), delta.counts());
}

/// Sets a kernel's RESULT_PARAMETERS, its last ones.
void Order::set_results(cl::Kernel& kernel, cl_uint first, const PairDelta& delta) {
  opencl::set_arguments(kernel, first, delta.next_counts(), is_awaited_ ? result().device() : cl::Buffer(),
                        report_.counts, report_.added, report_.removed);
}

/// @param event Is set to that of the last kernel, unless it is null.
void Order::enqueue_few(const PairDelta& delta, cl_uint tag, cl::Event* event) {
  const std::size_t group = engine_launch(context_).group;
  set_results(few_kernel_, set_changes(few_kernel_, delta, tag), delta);
  const std::size_t groups = opencl::divide_up(std::max<std::size_t>(room_, 1), layout::ORDER_RANGE);
  context_.queue().enqueueNDRangeKernel(few_kernel_, cl::NullRange, cl::NDRange(groups * group, 2),
                                        cl::NDRange(group, 1), nullptr, event);
}

/// @param event As above.
/// @param stage To which the other kernels belong.
void Order::enqueue_many(const PairDelta& delta, cl_uint tag, cl::Event* event,
                         opencl::Profiler::Scope& stage) {
  const std::size_t buckets = 2 * buckets_of_list_;
  if (zeros_ < buckets) context_.fill(bucket_counts_.get(), 0, 0, buckets, stage.event());
  const std::size_t zeros = std::max(buckets, std::exchange(zeros_, 0));
  // Each work-item handles several changes, but not so many that it exceeds opencl::most_iterations.
  const std::size_t most_items = std::max(std::size_t{1} << 20, capacity_ / 8);
  const std::size_t items = std::clamp(
      capacity_, std::min(most_items, context_.device().compute_units * std::size_t{64}), most_items);
  for (opencl::SizedKernel* sized : {&count_, &scatter_, &place_}) {
    cl::Kernel& kernel = sized->kernel;
    const cl_uint next = opencl::set_arguments(kernel, set_changes(kernel, delta, tag),
                                               sized == &count_ ? bucket_counts_.get() : buckets_.get(),
                                               scattered_.get(), filters_, last_filters_);
    if (sized == &place_) {
      kernel.setArg(next, bucket_counts_.get());
      set_results(kernel, next + 1, delta);
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
  if (is_awaited_) result().release();
  {
    opencl::Profiler::Scope stage(profiler_, "order");
    cl::Event* const own = stage.event();
    // Whether it is the last command before the host may read.
    const bool is_last = is_awaited_ && result().is_direct() && target_ == Target::device;
    cl::Event* const event = is_last ? &ready_ : own;
    many_ ? enqueue_many(delta, tag, event, stage) : enqueue_few(delta, tag, event);
    if (is_last && own != nullptr) *own = ready_;
    if (!is_awaited_ && worlds_ > 0) enqueue_offsets({}, stage);
    if (!is_awaited_ && second_set_ > 0) {
      renumber(report_.added, 0, report_.removed, 0, report_.counts, capacity_, &stage);
    }
  }
  if (is_awaited_) read(expected_);
}

void Order::enqueue_offsets(const PairDelta::Counts& counts, opencl::Profiler::Scope& stage) {
  opencl::set_arguments(offsets_.kernel, 0, static_cast<cl_uint>(worlds_), static_cast<cl_uint>(counts.added),
                        static_cast<cl_uint>(counts.removed), report_.counts, report_.added, report_.removed,
                        filters_, last_filters_, report_.added_offsets, report_.removed_offsets);
  offsets_.enqueue(context_.queue(), worlds_ + 2, stage.event());
}

/// @param counts The lengths of the lists; if null, the lengths are those given by the host.
/// @param pairs The largest number of pairs in both lists.
/// @param stage To which the command belongs; null if to none.
void Order::renumber(const cl::Buffer& added, std::size_t added_count, const cl::Buffer& removed,
                     std::size_t removed_count, const cl::Buffer& counts, std::size_t pairs,
                     opencl::Profiler::Scope* stage) {
  if (pairs == 0) return;
  constexpr std::size_t most_items = std::size_t{1} << 20;
  opencl::set_arguments(renumber_.kernel, 0, second_set_, static_cast<cl_uint>(added_count),
                        static_cast<cl_uint>(removed_count), counts, added, removed);
  renumber_.enqueue(context_.queue(), std::min(pairs, most_items), opencl::event_of(stage));
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
  const bool is_ordered =
      std::max(counts.added, counts.removed) <= room_ && changes <= capacity_ && !counts.is_unordered;
  was_bucket_too_large_ = was_bucket_too_large_ || counts.is_unordered;
  if (!is_ordered) sort_changes(delta, counts);
  if (worlds_ > 0 || second_set_ > 0) {
    opencl::Profiler::Scope stage(profiler_, "order");
    if (worlds_ > 0) enqueue_offsets(counts, stage);
    if (second_set_ > 0) renumber(added(), counts.added, removed(), counts.removed, {}, changes, &stage);
  }
  if (target_ == Target::host && (!is_ordered || changes > expected_)) {
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
    sort(to.get(), n, slots_, scattered_.get(), &stage);
    if (worlds_ > 0) sort_by_world(to.get(), n, filters, stage);
  };
  report_ = {};  // as in begin()
  sort_list(added_, delta.list(), delta.list_capacity() - counts.added, counts.added, filters_);
  sort_list(removed_, delta.removed(), 0, counts.removed, last_filters_);
  report_to_own_lists();
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

/// Sorts a list that is in canonical order by world, and canonically within a world.
void Order::sort_by_world(const cl::Buffer& pairs, std::size_t n, const cl::Buffer& filters,
                          opencl::Profiler::Scope& stage) {
  const cl::CommandQueue& queue = context_.queue();
  const cl::Buffer elements = context_.buffer(n * sizeof(Pair));
  const auto count = static_cast<cl_uint>(n);
  opencl::set_arguments(world_keys_.kernel, 0, count, static_cast<cl_uint>(worlds_), pairs, filters,
                        elements);
  world_keys_.enqueue(queue, n, stage.event());
  const auto bits = static_cast<unsigned>(std::bit_width(worlds_));
  sort_.enqueue(elements, scattered_.get(), n, {{32, bits}}, &stage);
  opencl::set_arguments(pick_.kernel, 0, count, elements, pairs, scattered_.get());
  pick_.enqueue(queue, n, stage.event());
  queue.enqueueCopyBuffer(scattered_.get(), pairs, 0, 0, n * sizeof(Pair), nullptr, stage.event());
}

void Order::commit(const PairDelta::Counts& counts) noexcept {
  last_changes_ = counts.added + counts.removed;
  longest_before_ = std::exchange(last_longest_, std::max(counts.added, counts.removed));
}

Delta Order::on_host(const PairDelta::Counts& counts) const noexcept {
  const opencl::SharedBuffer& buffer = frames_.last.result.get();
  const auto* changes = reinterpret_cast<const Pair*>(buffer.host() + PairDelta::count_bytes);
  return {{changes, counts.added}, {changes + counts.added, counts.removed}, buffer.owner()};
}

void Order::sort(const cl::Buffer& pairs, std::size_t n, std::size_t slots, const cl::Buffer& scratch,
                 opencl::Profiler::Scope* stage) {
  const auto bits = static_cast<unsigned>(std::bit_width(slots));
  sort_.enqueue(pairs, scratch, n, {{0, bits}, {32, bits}}, stage);
}

}  // namespace broadcl
