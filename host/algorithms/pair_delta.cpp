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
constexpr std::size_t count_removed = 2;
constexpr std::size_t count_work = 3;
constexpr std::size_t count_unordered = 4;
constexpr std::size_t count_bytes = 6 * sizeof(cl_uint);

constexpr std::size_t first_capacity = 1 << 14;
constexpr std::size_t most_pairs = std::size_t{1} << 31;  // places in a list are 32-bit numbers
/// Changes that are read with the counts, and room for them, at the least.
constexpr std::size_t least_changes = 512;

constexpr std::size_t group = 64;  // work-items a work-group that orders changes

// As kernels/order.cl has them.
constexpr std::size_t teams = 2;
constexpr std::size_t keys = 4;
constexpr std::size_t changes_multiple = 2 * teams * keys;

/// How kernels are cut.
struct Cut {
  std::size_t parts;  ///< Work-items that place pairs together.
  std::size_t group;  ///< Work-items a work-group that keeps pairs.
  std::size_t chunk;  ///< Pairs that each of them looks at.
  std::size_t few;    ///< Pairs of a list, added or removed, that are compared each with every other.
};
Cut cut(const opencl::Context& context) {
  if (context.shape() == opencl::Shape::cpu) return {.parts = 1, .group = 1, .chunk = 256, .few = 256};
  return {.parts = 128, .group = 256, .chunk = 1, .few = 4096};
}

using opencl::round_up;

/// Room for the changes of a frame after one that had so many. What is read by the host gets a fifth more
/// where it grows, and so is half as large again as it must be.
std::size_t usual_room(std::size_t changes) {
  return round_up(std::max(least_changes, changes + changes / 4), changes_multiple);
}

}  // namespace

PairDelta::PairDelta(const opencl::Context& context, opencl::Profiler& profiler)
    : context_(context), profiler_(profiler), sort_(context), scan_(context) {
  const Cut cut = broadcl::cut(context);
  const cl::Program keep = context.program(
      "delta.cl", "-DGROUP=" + std::to_string(cut.group) + " -DCHUNK=" + std::to_string(cut.chunk));
  const cl::Program order = context.program("order.cl", "-DPARTS=" + std::to_string(cut.parts));
  opencl::translate_errors(context.device().label(), [&] {
    keep_ = cl::Kernel(keep, "delta_keep");
    order_few_ = cl::Kernel(order, "order_few");
    order_count_ = cl::Kernel(order, "order_count");
    order_scatter_ = cl::Kernel(order, "order_scatter");
    order_place_ = cl::Kernel(order, "order_place");
    for (cl::Buffer& counts : counts_) counts = buffer(count_bytes);
    clear_counts();
    reserve(first_capacity);
    last_ = std::exchange(next_, {});
  });
}

cl::Buffer PairDelta::buffer(std::size_t bytes) const {
  if (bytes > context_.device().max_allocation) {
    throw Error(context_.device().label() + ": needs a buffer of " + std::to_string(bytes) +
                " bytes for the overlapping pairs, but the device allocates " +
                std::to_string(context_.device().max_allocation) +
                " at most; use fewer boxes, or a device with more memory");
  }
  return context_.buffer(bytes);
}

PairDelta::List PairDelta::make_list(std::size_t capacity) const {
  if (capacity > most_pairs) {
    throw Error(context_.device().label() + ": more than " + std::to_string(most_pairs) +
                " pairs overlap; use fewer boxes");
  }
  return {.capacity = static_cast<cl_uint>(capacity), .pairs = buffer(capacity * sizeof(Pair))};
}

/// Makes room for this many pairs in this frame and the next. What was found of this frame is lost. Where it
/// fails, there is room for none, and the next frame tries again.
void PairDelta::reserve(std::size_t capacity) {
  if (now_.capacity >= capacity) return;
  // Before others are made: memory need not hold the small and the large ones together.
  now_ = {};
  next_ = {};
  removed_ = {};
  List now = make_list(capacity);
  removed_ = buffer(capacity * sizeof(Pair));
  if (last_.capacity < capacity) next_ = make_list(capacity);
  now_ = std::move(now);
}

void PairDelta::reserve_result(std::size_t changes) {
  const std::size_t bytes = count_bytes + changes * sizeof(Pair);
  if (result_.bytes() >= bytes) return;
  result_ = {};
  result_ = opencl::SharedBuffer(context_, bytes + bytes / 5);
}

/// Buckets of either list; one at least, where neither frame has an object.
std::size_t PairDelta::bucket_count() const {
  return std::max<std::size_t>({1, slots_, frame_.search.slots});
}

void PairDelta::reserve_buckets() {
  const std::size_t slots = bucket_count();
  if (bucket_capacity_ < slots) {
    bucket_capacity_ = 0;
    buckets_ = {};
    buckets_ = buffer(2 * (slots + slots / 4) * sizeof(cl_uint));
    bucket_capacity_ = slots + slots / 4;
  }
  reserve_scattered(room_);
}

void PairDelta::reserve_scattered(std::size_t changes) {
  if (scattered_capacity_ >= changes) return;
  scattered_capacity_ = 0;
  scattered_ = {};
  scattered_ = buffer(changes * sizeof(Pair));
  scattered_capacity_ = changes;
}

void PairDelta::set_sink(cl::Kernel& kernel, cl_uint first) const {
  const Search& search = frame_.search;
  const bool has_last = search.last_slots > 0;  // else a buffer that is not read stands for the last boxes
  const bool any_last_filters = search.any_last_filters && !search.same_filters;
  opencl::set_arguments(kernel, first, now_.capacity, now_.pairs, has_last ? search.last_boxes : search.boxes,
                        search.last_slots, any_last_filters ? search.last_filters : search.stamps.words,
                        any_last_filters ? cl_uint{1} : cl_uint{0},
                        search.stamps.any_renewed ? cl_uint{1} : cl_uint{0}, search.stamps.stamp,
                        search.stamps.words, counts_[turn_]);
}

void PairDelta::enqueue_keep() {
  if (last_.found == 0) return;
  opencl::Profiler::Scope stage(profiler_, "keep");
  const Search& search = frame_.search;
  const bool any_filters = search.any_filters && !search.same_filters;
  opencl::set_arguments(keep_, 0, last_.found, last_.pairs, search.slots, search.boxes,
                        any_filters ? cl_uint{1} : cl_uint{0}, search.filters,
                        search.stamps.any_renewed ? cl_uint{1} : cl_uint{0}, search.stamps.stamp,
                        search.stamps.words, now_.capacity, now_.pairs, removed_, counts_[turn_]);
  const Cut cut = broadcl::cut(context_);
  const std::size_t groups = opencl::divide_up(last_.found, cut.group * cut.chunk);
  context_.queue().enqueueNDRangeKernel(keep_, cl::NullRange, cl::NDRange(groups * cut.group),
                                        cl::NDRange(cut.group), nullptr, stage.event());
}

void PairDelta::enqueue_order_few() {
  opencl::Profiler::Scope stage(profiler_, "order");
  const std::size_t parts = cut(context_).parts;
  opencl::set_arguments(order_few_, 0, now_.capacity, last_.found, now_.pairs, removed_, counts_[turn_],
                        counts_[1 - turn_], result_.device());
  context_.queue().enqueueNDRangeKernel(order_few_, cl::NullRange, cl::NDRange(parts, room_ / 2 / keys, 2),
                                        cl::NDRange(parts, teams, 1), nullptr, stage.event());
}

void PairDelta::enqueue_order_many() {
  const cl::CommandQueue& queue = context_.queue();
  const std::size_t slots = bucket_count();
  const opencl::Profiler::Scope all(profiler_, "order");
  queue.enqueueFillBuffer(buckets_, cl_uint{0}, 0, 2 * slots * sizeof(cl_uint));
  // Each goes through some changes, but never so many that llvmpipe would end it (see shape_of()).
  const std::size_t items = round_up(
      std::clamp(room_, context_.device().compute_units * std::size_t{64}, std::size_t{1} << 20), group);
  const auto enqueue = [&](cl::Kernel& kernel, cl::Event* event) {
    const cl_uint next = opencl::set_arguments(kernel, 0, static_cast<cl_uint>(room_),
                                               static_cast<cl_uint>(slots), now_.capacity, last_.found,
                                               now_.pairs, removed_, counts_[turn_], buckets_, scattered_);
    if (kernel() == order_place_()) {
      opencl::set_arguments(kernel, next, counts_[1 - turn_], result_.device());
    }
    queue.enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(items), cl::NDRange(group), nullptr, event);
  };
  enqueue(order_count_, nullptr);
  scan_.enqueue(buckets_, 2 * slots);
  enqueue(order_scatter_, nullptr);
  enqueue(order_place_, nullptr);
}

void PairDelta::enqueue_read(std::size_t changes) {
  opencl::Profiler::Scope stage(profiler_, "download");
  result_.download(count_bytes + changes * sizeof(Pair), &read_);
  if (stage.event() != nullptr) *stage.event() = read_;
}

void PairDelta::enqueue() {
  is_half_done_ = true;
  enqueue_keep();
  frame_.find();
  result_.lend();
  many_ ? enqueue_order_many() : enqueue_order_few();
  enqueue_read(expected_);
}

void PairDelta::wait() {
  opencl::Profiler::Scope stage(profiler_, "wait");
  read_.wait();
}

void PairDelta::clear_counts() {
  for (const cl::Buffer& counts : counts_) {
    context_.queue().enqueueFillBuffer(counts, cl_uint{0}, 0, count_bytes);
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
  if (is_half_done_) clear_counts();
  reserve(last_.capacity);
  if (frame_.stays_on_device) {
    many_ = false;
    room_ = least_changes;
  } else {
    many_ = last_longest_ > cut(context_).few;
    room_ = many_ ? usual_room(last_changes_)
                  : round_up(std::max(least_changes, 3 * last_longest_), changes_multiple);
  }
  expected_ = std::clamp(last_changes_ + last_changes_ / 8, least_changes, room_);
  reserve_result(room_);
  if (many_) reserve_buckets();
  enqueue();
}

PairDelta::Counts PairDelta::settle() {
  for (;;) {
    wait();
    const std::uint64_t found = counts()[count_found] | std::uint64_t{counts()[count_found_high]} << 32;
    if (found <= now_.capacity) {
      const std::size_t removed = counts()[count_removed];
      return {found, found + removed - last_.found, removed, counts()[count_work],
              counts()[count_unordered] != 0};
    }
    clear_counts();
    reserve(found + found / 4);
    enqueue();
  }
}

void PairDelta::commit(const Counts& counts) {
  profiler_.resolve();
  now_.found = static_cast<cl_uint>(counts.found);
  slots_ = frame_.search.slots;
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
  const bool has_room = many_ ? total <= room_ : 2 * std::max(counts.added, counts.removed) <= room_;
  if (!has_room || counts.is_unordered) {
    sort_changes(counts);
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
    added_ = buffer(std::max<std::size_t>(1, counts.added) * sizeof(Pair));
    copy_added(counts, added_);
    sort_lists(added_, counts);
  }
  commit(counts);
  return {added_, counts.added, removed_, counts.removed, counts.found};
}

/// The last of this frame's list.
void PairDelta::copy_added(const Counts& counts, const cl::Buffer& to) const {
  if (counts.added == 0) return;
  const std::size_t first = counts.found - counts.added;
  context_.queue().enqueueCopyBuffer(now_.pairs, to, first * sizeof(Pair), 0, counts.added * sizeof(Pair));
}

/// Pairs are of slots below both those of this frame and of the last.
void PairDelta::sort(const cl::Buffer& pairs, std::size_t n, const cl::Buffer& scratch) const {
  const auto bits = static_cast<unsigned>(std::bit_width(std::max<std::size_t>(slots_, frame_.search.slots)));
  sort_.enqueue(pairs, scratch, n,
                std::array{opencl::RadixSort::Bits{0, bits}, opencl::RadixSort::Bits{32, bits}});
}

/// Sorts what was added, and what was removed.
void PairDelta::sort_lists(const cl::Buffer& added, const Counts& counts) {
  // As much as the next frame will want.
  reserve_scattered(usual_room(counts.added + counts.removed));
  sort(added, counts.added, scattered_);
  sort(removed_, counts.removed, scattered_);
}

void PairDelta::sort_changes(const Counts& counts) {
  {
    opencl::Profiler::Scope stage(profiler_, "sort");
    reserve_result(usual_room(counts.added + counts.removed));
    const cl::Buffer added = buffer(std::max<std::size_t>(1, counts.added) * sizeof(Pair));
    copy_added(counts, added);
    sort_lists(added, counts);
    result_.lend();
    const cl::CommandQueue& queue = context_.queue();
    const std::size_t bytes = counts.added * sizeof(Pair);
    if (counts.added > 0) queue.enqueueCopyBuffer(added, result_.device(), 0, count_bytes, bytes);
    if (counts.removed > 0) {
      queue.enqueueCopyBuffer(removed_, result_.device(), 0, count_bytes + bytes,
                              counts.removed * sizeof(Pair));
    }
  }
  enqueue_read(counts.added + counts.removed);
  wait();
}

cl::Buffer PairDelta::sorted_pairs() const {
  const std::size_t bytes = std::max<std::size_t>(1, last_.found) * sizeof(Pair);
  cl::Buffer copy = context_.buffer(bytes);
  if (last_.found == 0) return copy;
  context_.queue().enqueueCopyBuffer(last_.pairs, copy, 0, 0, bytes);
  sort(copy, last_.found, context_.buffer(bytes));
  return copy;
}

std::vector<Pair> PairDelta::pairs() const {
  std::vector<Pair> all(last_.found);
  if (all.empty()) return all;
  context_.queue().enqueueReadBuffer(sorted_pairs(), CL_TRUE, 0, all.size() * sizeof(Pair), all.data());
  return all;
}

}  // namespace broadcl
