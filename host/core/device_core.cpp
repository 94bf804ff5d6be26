#include "core/device_core.hpp"

#include <algorithm>
#include <utility>

#include <broadcl/aabb.hpp>

#include "core/exclusions.hpp"
#include "opencl/error.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

constexpr std::size_t most_boxes = 0x7fffffff;
/// Instead of the number of boxes of the first of two sets, if there is only one set.
constexpr std::size_t no_second_set = ~std::size_t{0};

cl::CommandQueue retained(cl_command_queue queue, bool profile) {
  if (queue == nullptr)
    throw Error::invalid_argument("the queue is null; give one that was made by clCreateCommandQueue");
  auto [result, properties] = opencl::translate_errors("the queue", [&] {
    const cl::CommandQueue own(queue, true);
    return std::pair(own, own.getInfo<CL_QUEUE_PROPERTIES>());
  });
  if (profile && (properties & CL_QUEUE_PROFILING_ENABLE) == 0) {
    throw Error::invalid_argument(
        "profiling is requested, but the queue does not measure; make it with CL_QUEUE_PROFILING_ENABLE");
  }
  return result;
}

bool has_filters(const DeviceBroadPhase::Boxes& boxes) {
  return boxes.filters != nullptr || boxes.second.buffer != nullptr;
}

/// What must be the same in every update.
std::size_t first_count_of(const DeviceBroadPhase::Boxes& boxes) {
  return boxes.second.buffer != nullptr ? boxes.count : no_second_set;
}

cl_uint second_set_of(std::size_t first_count) {
  return first_count == no_second_set ? 0 : static_cast<cl_uint>(first_count);
}

std::size_t count_of(const DeviceBroadPhase::Boxes& boxes) {
  return boxes.count + (boxes.second.buffer != nullptr ? boxes.second.count : 0);
}

/// Encodes properties of the generation of an update, for settle().
cl_uint tag_of(const DeviceBroadPhase::Boxes& boxes) {
  return static_cast<cl_uint>(count_of(boxes)) << 1U | (has_filters(boxes) ? 1U : 0U);
}

/// In bytes, from each box to the next.
std::size_t distance(std::size_t stride) {
  return stride == 0 ? sizeof(Aabb) : stride;
}

}  // namespace

DeviceCore::DeviceCore(cl_command_queue queue, const DeviceBroadPhase::Config& config,
                       std::optional<opencl::Tuning> tuning)
    : context_(retained(queue, config.profile), config.on_compile, tuning),
      profiler_(config.profile),
      engine_(context_.guard([&] {
        return std::make_unique<Engine>(context_, profiler_, find_pair_finder(config.algorithm),
                                        Order::Target::device);
      })),
      source_(context_.guard([&] { return std::make_unique<Source>(context_); })) {}

DeviceCore::~DeviceCore() = default;

MemoryUse DeviceCore::memory() const noexcept {
  return context_.memory();
}

template <class Function>
std::invoke_result_t<const Function&> DeviceCore::guard_reservation(const Function& function) {
  try {
    return context_.guard(function);
  } catch (...) {
    must_reserve_again_ = true;
    throw;
  }
}

DeviceCorePointer make_device_core(cl_command_queue queue, const DeviceBroadPhase::Config& config) {
  return opencl::make_tuned([&](std::optional<opencl::Tuning> tuning) {
    return DeviceCorePointer(new DeviceCore(queue, config, tuning));
  });
}

// (Not guarded: after a refusal there is nothing to wait for.)
void DeviceCore::refuse_invalid(const Boxes& boxes) const {
  opencl::translate_errors(context_.device().label(), [&] { check(boxes); });
}

void DeviceCore::read(cl_mem buffer, std::size_t offset, std::span<std::byte> to) const {
  if (to.empty()) return;
  context_.guard([&] {
    context_.queue().enqueueReadBuffer(cl::Buffer(buffer, true), CL_TRUE, offset, to.size(), to.data());
  });
}

void DeviceCore::begin(const Boxes& boxes) {
  refuse_in_flight("begin()");
  refuse_invalid(boxes);
  guard_reservation([&] {
    settle();
    profiler_.begin();
    engine_->prepare();
    engine_->begin(search_of(boxes), tag_of(boxes));
    engine_->search();
    context_.queue().flush();
  });
  begun_first_count_ = first_count_of(boxes);
  in_flight_ = true;
}

void DeviceCore::complete() {
  if (!in_flight_) throw Error("finish() was called without begin()");
  in_flight_ = false;
  completed_ = guard_reservation([&] { return engine_->complete(); });
}

// NOLINTNEXTLINE(bugprone-exception-escape): handles do not throw when moved
DeviceBroadPhase::Result DeviceCore::commit() noexcept {
  engine_->commit(completed_);
  const PairDelta::Counts& counts = completed_.counts;
  first_count_ = begun_first_count_;
  complete_exclusions_ = exclusions_;
  const Order& changes = engine_->changes();
  Result result{.added = {changes.added()(), counts.added, changes.added_offsets()()},
                .removed = {changes.removed()(), counts.removed, changes.removed_offsets()()},
                .pair_count = counts.found,
                .invalid_boxes = counts.invalid_boxes,
                .first_invalid = {},
                .incomplete = std::exchange(incomplete_, 0)};
  if (counts.invalid_boxes > 0) result.first_invalid = static_cast<std::uint32_t>(counts.first_invalid);
  return result;
}

void DeviceCore::abandon() noexcept {
  if (!std::exchange(in_flight_, false)) return;
  must_reserve_again_ = true;  // as after any other failure
  opencl::wait_if_possible(context_.queue());
}

void DeviceCore::reserve(std::size_t boxes, std::size_t pairs, bool filters) {
  refuse_in_flight("reserve()");
  if (boxes > most_boxes) throw Error::invalid_argument("more than 2147483647 boxes; give fewer");
  reserved_ = {};  // until all is done
  const Reservation wanted{.boxes = boxes, .pairs = pairs, .filters = filters};
  context_.guard([&] { fulfil(wanted); });
  reserved_ = wanted;
}

void DeviceCore::shrink() {
  refuse_in_flight("shrink()");
  context_.guard([&] {
    settle();
    auto engine = engine_->successor();
    auto source = std::make_unique<Source>(context_);
    const Frame& last = engine_->frames().last;
    if (last.objects.slots > 0) {
      Frame& smaller = engine->frames().last;
      smaller.objects = last.objects;
      reserve(smaller, last.objects.slots, last.objects.filters() != nullptr);
      copy(last, smaller);
    }
    // Nothing below throws.
    engine_ = std::move(engine);
    source_ = std::move(source);
    pairs_ = {};
    reserved_ = {};
    must_reserve_again_ = false;
    opencl::wait_if_possible(context_.queue());
  });
}

void DeviceCore::set_exclusions(std::span<const Pair> pairs) {
  refuse_in_flight("set_exclusions()");
  std::vector<Pair> list = sorted_exclusions(pairs);
  context_.guard([&] {
    settle();
    cl::Buffer buffer;
    if (!list.empty()) {
      list.insert(list.begin(), {.a = static_cast<std::uint32_t>(list.size()), .b = 0});
      const std::size_t bytes = list.size() * sizeof(Pair);
      if (bytes > context_.device().max_allocation) {
        throw Error("the device allocates at most " + std::to_string(context_.device().max_allocation) +
                        " bytes, too few for the exclusions; give fewer",
                    ErrorKind::out_of_device_memory);
      }
      buffer = context_.buffer(bytes);
      context_.queue().enqueueWriteBuffer(buffer, CL_TRUE, 0, bytes, list.data());
    }
    exclusions_ = buffer;
  });
}

void DeviceCore::enqueue(const Boxes& boxes, const ChangeBuffers& changes) {
  refuse_in_flight("enqueue()");
  if (count_of(boxes) > reserved_.boxes) {
    throw Error::invalid_argument("enqueue() was given " + std::to_string(count_of(boxes)) +
                                  " boxes, but reserve() was called for " + std::to_string(reserved_.boxes) +
                                  "; call it for as many");
  }
  if (has_filters(boxes) && !reserved_.filters) {
    throw Error::invalid_argument(
        "enqueue() was given " +
        std::string(boxes.filters != nullptr ? "filters" : "a second set, which takes filters") +
        ", but reserve() was called without; call it with filters");
  }
  opencl::translate_errors(context_.device().label(), [&] {
    check(boxes);
    check(changes, boxes);
  });
  guard_reservation([&] {
    if (engine_->was_interrupted()) settle();
    if (must_reserve_again_) fulfil(reserved_);
    profiler_.begin();
    engine_->prepare();
    engine_->enqueue(search_of(boxes), tag_of(boxes),
                     {.added = cl::Buffer(changes.added, true),
                      .removed = cl::Buffer(changes.removed, true),
                      .counts = cl::Buffer(changes.counts, true),
                      .capacity = changes.capacity,
                      .added_offsets = cl::Buffer(changes.added_offsets, true),
                      .removed_offsets = cl::Buffer(changes.removed_offsets, true)});
  });
  first_count_ = first_count_of(boxes);
}

DeviceBroadPhase::PairBuffer DeviceCore::pairs() {
  refuse_in_flight("pairs()");
  return context_.guard([&]() -> PairBuffer {
    settle();
    pairs_ = engine_->sorted_pairs();
    return {pairs_(), engine_->pair_count()};
  });
}

void DeviceCore::fulfil(const Reservation& wanted) {
  settle();
  auto& [now, last] = engine_->frames();
  const std::size_t slots = std::max<std::size_t>(wanted.boxes, last.objects.slots);
  engine_->reserve_ahead(slots, wanted.pairs);
  reserve(now, slots, wanted.filters);
  Frame larger;
  larger.objects = last.objects;
  larger.boxes = last.boxes;
  larger.filters = last.filters;
  reserve(larger, slots, wanted.filters);
  copy(last, larger);
  last.objects = std::move(larger.objects);
  last.boxes = std::move(larger.boxes);
  last.filters = std::move(larger.filters);
  must_reserve_again_ = false;
}

void DeviceCore::refuse_in_flight(const std::string& call) const {
  if (in_flight_) throw Error(call + " was called between begin() and finish(); call finish() first");
}

void DeviceCore::settle() {
  if (!engine_->is_unsettled()) return;
  const PairDelta::Settled settled = engine_->settle();
  const std::size_t incomplete = settled.frames - settled.complete;
  if (settled.complete > 0) complete_exclusions_ = exclusions_;
  Frame& last = engine_->frames().last;
  last.objects = {.slots = settled.tag >> 1U,
                  .boxes = last.boxes.get(),
                  .filters = (settled.tag & 1U) != 0 ? last.filters.get() : cl::Buffer(),
                  .exclusions = complete_exclusions_,
                  .second_set = second_set_of(*first_count_)};
  incomplete_ += incomplete;
}

void DeviceCore::reserve(Frame& frame, std::size_t boxes, bool filters) const {
  frame.boxes.reserve(context_, (boxes + Generation::padding) * sizeof(Aabb), "boxes");
  if (filters) frame.filters.reserve(context_, (boxes + Generation::padding) * sizeof(Filter), "filters");
}

void DeviceCore::copy(const Frame& from, Frame& to) const {
  const std::size_t slots = from.objects.slots;
  if (slots == 0) return;
  if (to.boxes.get()() != from.boxes.get()()) {
    context_.queue().enqueueCopyBuffer(from.boxes.get(), to.boxes.get(), 0, 0, slots * sizeof(Aabb));
    to.objects.boxes = to.boxes.get();
  }
  if (from.objects.filters() == nullptr || to.filters.get()() == from.filters.get()()) return;
  context_.queue().enqueueCopyBuffer(from.filters.get(), to.filters.get(), 0, 0, slots * sizeof(Filter));
  to.objects.filters = to.filters.get();
}

void DeviceCore::check(const ChangeBuffers& changes, const Boxes& boxes) const {
  if (changes.capacity == 0) throw Error::invalid_argument("the capacity for changes is 0; give at least 1");
  const std::size_t capacity = changes.capacity;
  check_buffer("added pairs", changes.added, capacity, 0, sizeof(Pair), sizeof(Pair));
  check_buffer("removed pairs", changes.removed, capacity, 0, sizeof(Pair), sizeof(Pair));
  check_buffer("counts", changes.counts, 4, 0, sizeof(cl_uint), sizeof(cl_uint));
  if (boxes.ordered_worlds == 0) return;
  const std::size_t offsets = boxes.ordered_worlds + 2;
  check_buffer("added offsets", changes.added_offsets, offsets, 0, sizeof(cl_uint), sizeof(cl_uint));
  check_buffer("removed offsets", changes.removed_offsets, offsets, 0, sizeof(cl_uint), sizeof(cl_uint));
  if (boxes.ordered_worlds > reserved_.boxes) {
    throw Error::invalid_argument("enqueue() was given " + std::to_string(boxes.ordered_worlds) +
                                  " worlds, but reserve() was called for fewer boxes; call it for as many");
  }
}

void DeviceCore::check(const Boxes& boxes) const {
  if (boxes.ordered_worlds > most_boxes)
    throw Error::invalid_argument("more than 2147483647 worlds; give fewer");
  const DeviceBroadPhase::SecondSet& second = boxes.second;
  if (second.buffer == nullptr && second.count > 0) {
    throw Error::invalid_argument(
        "the buffer of the second set is null; give one of the queue's context, or a count of 0");
  }
  if (boxes.count > most_boxes || second.count > most_boxes - boxes.count) {
    throw Error::invalid_argument("more than 2147483647 boxes; give fewer");
  }
  check_set("boxes", boxes.buffer, boxes.count, boxes.offset, boxes.stride);
  check_set("the second set", second.buffer, second.count, second.offset, second.stride);
  if (first_count_ && *first_count_ != first_count_of(boxes)) {
    throw Error::invalid_argument(
        "whether there is a second set, and the number of boxes of the first set then, must be the same in "
        "every update; give empty boxes for objects that are gone, or make a new object");
  }
  const std::size_t count = count_of(boxes);
  if (boxes.filters == nullptr || count == 0) return;
  check_buffer("filters", boxes.filters, count, 0, sizeof(Filter), sizeof(Filter));
}

void DeviceCore::check_set(const std::string& what, cl_mem buffer, std::size_t count, std::size_t offset,
                           std::size_t stride) const {
  if (count == 0) return;
  if (offset % sizeof(float) != 0 || stride % sizeof(float) != 0) {
    throw Error::invalid_argument("offset and stride of " + what + " must be multiples of 4 bytes");
  }
  check_buffer(what, buffer, count, offset, distance(stride), sizeof(Aabb));
}

void DeviceCore::check_buffer(const std::string& what, cl_mem memory, std::size_t count, std::size_t offset,
                              std::size_t stride, std::size_t size) const {
  if (memory == nullptr)
    throw Error::invalid_argument("the buffer of " + what + " is null; give one of the queue's context");
  const cl::Buffer buffer(memory, true);
  if (buffer.getInfo<CL_MEM_CONTEXT>()() != context_.context()()) {
    throw Error::invalid_argument("the buffer of " + what +
                                  " is of another context; give one of the queue's context");
  }
  const auto bytes = buffer.getInfo<CL_MEM_SIZE>();
  const bool fits = offset <= bytes && size <= bytes - offset &&
                    (count == 1 || stride <= (bytes - offset - size) / (count - 1));
  if (!fits) {
    throw Error::invalid_argument("the buffer of " + what + " has " + std::to_string(bytes) +
                                  " bytes, too few for " + std::to_string(count) + " at " +
                                  std::to_string(offset) + " with a stride of " + std::to_string(stride) +
                                  "; check count, offset and stride");
  }
}

Search DeviceCore::search_of(const Boxes& boxes) {
  auto& [next, last] = engine_->frames();
  const bool filters = has_filters(boxes);
  const DeviceBroadPhase::SecondSet& second = boxes.second;
  const bool is_of_two = second.buffer != nullptr;
  reserve(next, count_of(boxes), filters);
  next.objects = {.slots = static_cast<cl_uint>(count_of(boxes)),
                  .boxes = next.boxes.get(),
                  .filters = filters ? next.filters.get() : cl::Buffer(),
                  .exclusions = exclusions_,
                  .second_set = second_set_of(first_count_of(boxes))};
  source_->set({.buffer = cl::Buffer(boxes.buffer, true),
                .count = boxes.count,
                .offset = boxes.offset / sizeof(float),
                .stride = distance(boxes.stride) / sizeof(float)},
               {.buffer = cl::Buffer(second.buffer, true),
                .count = second.count,
                .offset = second.offset / sizeof(float),
                .stride = distance(second.stride) / sizeof(float)},
               cl::Buffer(boxes.filters, true));
  return {.now = next.objects,
          .last = last.objects,
          .source = source_.get(),
          .worlds = boxes.worlds && boxes.filters != nullptr,
          .sets = is_of_two,
          .ordered_worlds = static_cast<cl_uint>(boxes.ordered_worlds)};
}

}  // namespace broadcl
