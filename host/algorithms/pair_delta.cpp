#include "algorithms/pair_delta.hpp"

#include <algorithm>
#include <bit>
#include <string>
#include <utility>

#include <broadcl/error.hpp>

#include "opencl/error.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

// As kernels/delta.h has them.
constexpr std::size_t count_found = 0;
constexpr std::size_t count_found_high = 1;
constexpr std::size_t count_added = 2;
constexpr std::size_t count_removed = 3;
constexpr std::size_t count_work = 4;
constexpr std::size_t count_bytes = 6 * sizeof(cl_uint);

constexpr std::size_t first_capacity = 1 << 14;
constexpr std::size_t most_pairs = std::size_t{1} << 31;  // places in a list are 32-bit numbers
/// Pairs of a list, added or removed, that are put in order by comparing each with every other; longer lists
/// are sorted.
std::size_t most_ordered(const opencl::Context& context) {
  return context.shape() == opencl::Shape::cpu ? 1 << 8 : 1 << 14;
}
constexpr std::size_t least_ordered = 256;

// As kernels/delta.cl has them.
constexpr std::size_t teams = 2;
constexpr std::size_t keys = 4;

constexpr std::size_t group = 64;  // of the other kernels

/// Work-items that place pairs together.
std::size_t parts(const opencl::Context& context) {
  return context.shape() == opencl::Shape::cpu ? 1 : 64;
}

using opencl::round_up;

}  // namespace

PairDelta::PairDelta(const opencl::Context& context, opencl::Profiler& profiler)
    : context_(context), profiler_(profiler), sort_(context) {
  const cl::Program program = context.program("delta.cl", "-DPARTS=" + std::to_string(parts(context)));
  opencl::translate_errors(context.device().label(), [&] {
    carry_ = cl::Kernel(program, "delta_carry");
    index_ = cl::Kernel(program, "delta_index");
    sweep_ = cl::Kernel(program, "delta_sweep");
    order_ = cl::Kernel(program, "delta_order");
    for (cl::Buffer& counts : counts_) counts = zeros(count_bytes);
    reserve(first_capacity);
    last_ = std::move(next_);
    next_ = {};
  });
}

cl::Buffer PairDelta::zeros(std::size_t bytes) const {
  if (bytes > context_.device().max_allocation) {
    throw Error(context_.device().label() + ": needs a buffer of " + std::to_string(bytes) +
                " bytes for the overlapping pairs, but the device allocates " +
                std::to_string(context_.device().max_allocation) +
                " at most; use fewer boxes, or a device with more memory");
  }
  cl::Buffer buffer(context_.context(), CL_MEM_READ_WRITE, bytes);
  context_.queue().enqueueFillBuffer(buffer, cl_uint{0}, 0, bytes);
  return buffer;
}

PairDelta::Table PairDelta::make_table(std::size_t capacity) const {
  Table table;
  if (capacity > most_pairs) {
    throw Error(context_.device().label() + ": more than " + std::to_string(most_pairs) +
                " pairs overlap; use fewer boxes");
  }
  capacity = round_up(capacity, 64);
  const std::size_t entries = std::bit_ceil(2 * capacity);
  table.capacity = static_cast<cl_uint>(capacity);
  table.mask = static_cast<cl_uint>(entries - 1);
  table.pairs = zeros(capacity * sizeof(Pair));
  table.table = zeros(entries * sizeof(cl_uint));
  table.kept = zeros(capacity);
  return table;
}

/// Makes room for this many pairs in this frame and the next. Nothing changes where it fails.
void PairDelta::reserve(std::size_t capacity) {
  if (now_.capacity >= capacity) return;
  Table now = make_table(capacity);
  Table next = make_table(capacity);
  cl::Buffer added = zeros(now.capacity * sizeof(Pair));
  cl::Buffer removed = zeros(now.capacity * sizeof(Pair));
  now_ = std::move(now);
  next_ = std::move(next);
  added_ = std::move(added);
  removed_ = std::move(removed);
}

void PairDelta::reserve_result(std::size_t changes) {
  const std::size_t bytes = count_bytes + changes * sizeof(Pair);
  if (result_.bytes() < bytes) result_ = opencl::SharedBuffer(context_, bytes + bytes / 2);
}

void PairDelta::set_sink(cl::Kernel& kernel, cl_uint first) const {
  opencl::set_arguments(kernel, first, now_.capacity, now_.pairs, now_.table, now_.mask, last_.pairs,
                        last_.table, last_.mask, last_.kept,
                        frame_.stamps.any_renewed ? cl_uint{1} : cl_uint{0}, frame_.stamps.stamp,
                        frame_.stamps.words, added_, counts_[turn_]);
}

void PairDelta::enqueue_carry() {
  if (!frame_.carry || last_.found == 0) return;
  opencl::Profiler::Scope stage(profiler_, "carry");
  set_sink(carry_, opencl::set_arguments(carry_, 0, last_.found));
  context_.queue().enqueueNDRangeKernel(carry_, cl::NullRange, cl::NDRange(round_up(last_.found, group)),
                                        cl::NDRange(group), nullptr, stage.event());
}

void PairDelta::enqueue_sweep() {
  opencl::Profiler::Scope stage(profiler_, "sweep");
  opencl::set_arguments(sweep_, 0, now_.capacity, last_.pairs, last_.found, last_.table, last_.mask,
                        last_.kept, removed_, counts_[turn_]);
  // Each goes through some entries, but never so many that llvmpipe would end it (see shape_of()).
  const std::size_t useful = context_.device().compute_units * std::size_t{1024};
  const std::size_t items =
      std::max<std::size_t>(last_.mask / 4096 + 1, std::min<std::size_t>(last_.mask, useful));
  context_.queue().enqueueNDRangeKernel(sweep_, cl::NullRange, cl::NDRange(round_up(items, group)),
                                        cl::NDRange(group), nullptr, stage.event());
}

void PairDelta::enqueue_order() {
  opencl::Profiler::Scope stage(profiler_, "order");
  opencl::set_arguments(order_, 0, now_.capacity, added_, removed_, counts_[turn_], counts_[1 - turn_],
                        result_.device());
  context_.queue().enqueueNDRangeKernel(order_, cl::NullRange,
                                        cl::NDRange(parts(context_), ordered_ / keys, 2),
                                        cl::NDRange(parts(context_), teams, 1), nullptr, stage.event());
}

void PairDelta::enqueue_read(std::size_t changes) {
  opencl::Profiler::Scope stage(profiler_, "download");
  result_.download(count_bytes + changes * sizeof(Pair), &read_);
  if (stage.event() != nullptr) *stage.event() = read_;
}

void PairDelta::enqueue() {
  is_half_done_ = true;
  frame_.find();
  enqueue_carry();
  enqueue_sweep();
  result_.lend();
  enqueue_order();
  enqueue_read(expected_);
}

void PairDelta::wait() {
  opencl::Profiler::Scope stage(profiler_, "wait");
  read_.wait();
}

void PairDelta::restore_last() {
  const cl::CommandQueue& queue = context_.queue();
  for (const Table* table : {&now_, &last_}) {
    queue.enqueueFillBuffer(table->table, cl_uint{0}, 0, (std::size_t{table->mask} + 1) * sizeof(cl_uint));
  }
  queue.enqueueFillBuffer(last_.kept, cl_uint{0}, 0, last_.capacity);
  for (const cl::Buffer& counts : counts_) queue.enqueueFillBuffer(counts, cl_uint{0}, 0, count_bytes);
  if (last_.found > 0) {
    opencl::set_arguments(index_, 0, last_.found, last_.pairs, last_.table, last_.mask);
    queue.enqueueNDRangeKernel(index_, cl::NullRange, cl::NDRange(round_up(last_.found, group)),
                               cl::NDRange(group));
  }
  is_half_done_ = false;
}

const cl_uint* PairDelta::counts() const {
  return reinterpret_cast<const cl_uint*>(result_.host());
}

std::span<Pair> PairDelta::changes(std::size_t total) const {
  return {reinterpret_cast<Pair*>(result_.host() + count_bytes), total};
}

void PairDelta::begin(Frame frame) {
  frame_ = std::move(frame);
  if (is_half_done_) restore_last();
  const std::size_t longest = frame_.stays_on_device ? 0 : last_longest_ + last_longest_ / 2;
  ordered_ = round_up(std::clamp(longest, least_ordered, most_ordered(context_)), teams * keys);
  expected_ = std::clamp(last_changes_ + last_changes_ / 2, 2 * least_ordered, 2 * ordered_);
  reserve_result(2 * ordered_);
  enqueue();
}

PairDelta::Counts PairDelta::settle() {
  for (;;) {
    wait();
    const std::uint64_t found = counts()[count_found] | std::uint64_t{counts()[count_found_high]} << 32;
    if (found <= now_.capacity)
      return {found, counts()[count_added], counts()[count_removed], counts()[count_work]};
    restore_last();
    reserve(found + found / 4);
    enqueue();
  }
}

void PairDelta::commit(const Counts& counts) {
  profiler_.resolve();
  now_.found = static_cast<cl_uint>(counts.found);
  slots_ = frame_.slots;
  work_ = counts.work;
  ++frames_;
  last_changes_ = counts.added + counts.removed;
  last_longest_ = std::max(counts.added, counts.removed);
  turn_ = 1 - turn_;
  std::swap(now_, last_);
  if (next_.capacity > now_.capacity) now_ = std::exchange(next_, {});
  is_half_done_ = false;
}

Delta PairDelta::finish() {
  const Counts counts = settle();
  const std::size_t total = counts.added + counts.removed;
  if (std::max(counts.added, counts.removed) > ordered_) {
    sort_changes(counts.added, counts.removed);
  } else if (total > expected_) {
    enqueue_read(total);
    wait();
  }
  commit(counts);
  return {changes(total).first(counts.added), changes(total).subspan(counts.added)};
}

PairDelta::OnDevice PairDelta::finish_on_device() {
  const Counts counts = settle();
  {
    const opencl::Profiler::Scope stage(profiler_, "sort");
    sort(added_, counts.added);
    sort(removed_, counts.removed);
  }
  commit(counts);
  return {added_, counts.added, removed_, counts.removed, counts.found};
}

/// Pairs are of slots below both those of this frame and of the last.
void PairDelta::sort(const cl::Buffer& pairs, std::size_t n) const {
  if (n < 2) return;
  const auto bits = static_cast<unsigned>(std::bit_width(std::max(slots_, frame_.slots)));
  const cl::Buffer scratch(context_.context(), CL_MEM_READ_WRITE, n * sizeof(Pair));
  sort_.enqueue(pairs, scratch, n,
                std::array{opencl::RadixSort::Bits{0, bits}, opencl::RadixSort::Bits{32, bits}});
}

void PairDelta::sort_changes(std::size_t added, std::size_t removed) {
  {
    opencl::Profiler::Scope stage(profiler_, "sort");
    reserve_result(added + removed);
    sort(added_, added);
    sort(removed_, removed);
    result_.lend();
    const cl::CommandQueue& queue = context_.queue();
    const std::size_t bytes = added * sizeof(Pair);
    if (added > 0) queue.enqueueCopyBuffer(added_, result_.device(), 0, count_bytes, bytes);
    if (removed > 0) {
      queue.enqueueCopyBuffer(removed_, result_.device(), 0, count_bytes + bytes, removed * sizeof(Pair));
    }
  }
  enqueue_read(added + removed);
  wait();
}

cl::Buffer PairDelta::sorted_pairs() const {
  const std::size_t bytes = std::max<std::size_t>(1, last_.found) * sizeof(Pair);
  cl::Buffer copy(context_.context(), CL_MEM_READ_WRITE, bytes);
  if (last_.found == 0) return copy;
  context_.queue().enqueueCopyBuffer(last_.pairs, copy, 0, 0, bytes);
  sort(copy, last_.found);
  return copy;
}

std::vector<Pair> PairDelta::pairs() const {
  std::vector<Pair> all(last_.found);
  if (all.empty()) return all;
  context_.queue().enqueueReadBuffer(sorted_pairs(), CL_TRUE, 0, all.size() * sizeof(Pair), all.data());
  return all;
}

}  // namespace broadcl
