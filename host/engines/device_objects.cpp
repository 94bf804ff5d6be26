#include "engines/device_objects.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>

#include <broadcl/error.hpp>

#include "base/box_replacement.hpp"
#include "base/packed_box.hpp"
#include "engines/kernel_layout.hpp"
#include "opencl/common_program.hpp"
#include "opencl/direct_memory.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

constexpr std::size_t most_slots = std::size_t{1} << 31;  // a slot and a bit share a word
constexpr std::size_t least_slots = 256;

/// Memory in which to stage changes.
opencl::MappedBuffer staging(const opencl::Context& context, std::size_t bytes) {
  return context.has_direct_memory() ? opencl::MappedBuffer::direct(context, bytes)
                                     : opencl::MappedBuffer::pinned(context, bytes);
}

/// Memory for boxes, which their users may keep.
std::shared_ptr<opencl::MappedBuffer> staged_boxes(const opencl::Context& context, std::size_t bytes) {
  std::shared_ptr<opencl::MappedBuffer> staged(
      new opencl::MappedBuffer(opencl::MappedBuffer::pinned(context, bytes)), opencl::DeleteAndWait());
  std::fill_n(reinterpret_cast<Aabb*>(staged->host()), bytes / sizeof(Aabb), packed_empty());
  return staged;
}

/// Bytes of staged changes: one word each, and their boxes unless all boxes are uploaded.
std::size_t staged_bytes(std::size_t changes, bool boxes) {
  return changes * (sizeof(cl_uint) + (boxes ? sizeof(Aabb) : 0));
}

}  // namespace

DeviceObjects::DeviceObjects(const opencl::Context& context, opencl::Profiler& profiler, Frames& frames)
    : context_(context), profiler_(profiler), now_(frames.now), last_(frames.last) {
  const cl::Program program = opencl::common_program(context);
  apply_ = context.sized_kernel(program, "apply_changes");
  apply_filters_ = context.sized_kernel(program, "apply_filters");
  copy_ = context.sized_kernel(program, "copy_boxes");
  reserve_boxes(1);
}

std::span<Aabb> DeviceObjects::boxes() const noexcept {
  return {reinterpret_cast<Aabb*>(boxes_->host()), capacity_};
}

void DeviceObjects::reserve(std::size_t slots, bool filters) {
  // Filters first, so that boxes that have memory also have memory for filters, even if the other fails.
  const std::size_t bytes = capacity_for(slots) * sizeof(Filter);
  if (filters && staged_filters_.bytes() < bytes) {
    staged_filters_ = staging(context_, bytes);
  }
  if (slots > capacity_) reserve_boxes(slots);
}

void DeviceObjects::reserve_exclusions(std::size_t count) {
  if (count == 0) return;
  const std::size_t bytes = (count + 1) * sizeof(Pair);
  if (staged_exclusions_.bytes() < bytes)
    staged_exclusions_ = opencl::MappedBuffer::pinned(context_, opencl::grown(context_, bytes, "exclusions"));
}

/// The number of slots for which there is memory after reserve(slots).
std::size_t DeviceObjects::capacity_for(std::size_t slots) const {
  if (slots <= capacity_) return capacity_;
  if (slots > most_slots) {
    throw Error(context_.device().label() + ": more than " + std::to_string(most_slots) +
                " objects; use fewer");
  }
  const std::size_t needed = (std::max(slots, least_slots) + Generation::padding) * sizeof(Aabb);
  const std::size_t bytes = opencl::grown(context_, needed, "boxes");
  return std::min(most_slots, bytes / sizeof(Aabb) - Generation::padding);
}

std::size_t DeviceObjects::bytes_for(std::size_t slots) const noexcept {
  return (slots + Generation::padding) * sizeof(Aabb);
}

std::span<Aabb> DeviceObjects::spare_boxes() {
  if (spare_ == nullptr) spare_ = staged_boxes(context_, bytes_for(capacity_));
  return {reinterpret_cast<Aabb*>(spare_->host()), capacity_};
}

void DeviceObjects::reserve_boxes(std::size_t slots) {
  const std::size_t capacity = capacity_for(slots);
  const std::size_t bytes = bytes_for(capacity);
  // An update has at most a quarter of the slots in `changed`, with their boxes, or all slots recycled,
  // without boxes.
  const std::size_t staged = std::max(staged_bytes(capacity / 4 + 1, true), staged_bytes(capacity, false));
  std::shared_ptr<opencl::MappedBuffer> boxes = staged_boxes(context_, bytes);
  auto staged_changes = staging(context_, staged);
  cl::Buffer last = context_.buffer(bytes);
  cl::Buffer next = context_.buffer(bytes);
  cl::Buffer stamps = context_.buffer(capacity * sizeof(cl_uint));
  const cl::CommandQueue& queue = context_.queue();
  context_.fill(stamps, 0, 0, capacity);
  if (last_.objects.slots > 0) {
    queue.enqueueCopyBuffer(last_.objects.boxes, last, 0, 0, last_.objects.slots * sizeof(Aabb));
  }
  if (capacity_ > 0) std::memcpy(boxes->host(), boxes_->host(), capacity_ * sizeof(Aabb));
  boxes_ = std::move(boxes);
  spare_.reset();
  staged_changes_ = std::move(staged_changes);
  last_.objects.boxes = std::move(last);
  last_.all_uploaded = true;  // now_ has none of them
  now_.objects.boxes = std::move(next);
  stamps_ = std::move(stamps);
  capacity_ = capacity;
}

void DeviceObjects::upload_filters(const Input& input) {
  const std::size_t count = input.rules.filters.size();
  const std::size_t known = std::min(count, last_.filter_count);
  const std::size_t changed = input.rules.refiltered.size() + count - known;
  are_filters_new_ = input.rules.all_changed || changed > 0;
  now_.filter_count = are_filters_new_ ? count : last_.filter_count;
  now_.objects.filters = are_filters_new_ ? cl::Buffer() : last_.objects.filters;
  if (!are_filters_new_) return;
  const Frame::Filters& last = last_.filters;
  Frame::Filters& next = now_.filters;
  next.all = input.rules.all_changed || changed > count / 4;
  next.slots.clear();
  if (count == 0) return;
  const std::size_t bytes = (capacity_ + Generation::padding) * sizeof(Filter);
  const bool is_older_known = !last.all && next.buffer.bytes() >= bytes;
  next.buffer.reserve(context_, bytes, "filters");
  now_.objects.filters = next.buffer.get();
  const cl::CommandQueue& queue = context_.queue();
  if (next.all) {
    opencl::Profiler::Scope stage(profiler_, "upload");
    std::memcpy(staged_filters_.host(), input.rules.filters.data(), input.rules.filters.size_bytes());
    queue.enqueueWriteBuffer(next.buffer.get(), CL_FALSE, 0, input.rules.filters.size_bytes(),
                             staged_filters_.host(), nullptr, stage.event());
    return;
  }
  next.slots.assign(input.rules.refiltered.begin(), input.rules.refiltered.end());
  for (std::size_t slot = known; slot < count; ++slot) {
    next.slots.push_back(static_cast<std::uint32_t>(slot));
  }
  stale_ = next.slots;
  if (is_older_known) {
    // The buffer has the filters before those of the last frame.
    stale_.insert(stale_.end(), last.slots.begin(), last.slots.end());
  } else {
    opencl::Profiler::Scope stage(profiler_, "copy");
    queue.enqueueCopyBuffer(last.buffer.get(), next.buffer.get(), 0, 0, known * sizeof(Filter), nullptr,
                            stage.event());
  }
  std::ranges::sort(stale_);
  stale_.erase(std::unique(stale_.begin(), stale_.end()), stale_.end());
  apply_filters(input);
}

/// Uploads the filters of the slots in stale_, at most half of all.
void DeviceObjects::apply_filters(const Input& input) {
  const auto count = static_cast<cl_uint>(stale_.size());
  auto* filters = reinterpret_cast<Filter*>(staged_filters_.host());
  auto* slots = reinterpret_cast<cl_uint*>(filters + count);
  for (const std::uint32_t slot : stale_) {
    *filters++ = input.rules.filters[slot];
    *slots++ = slot;
  }
  const std::size_t bytes = count * (sizeof(Filter) + sizeof(cl_uint));
  const bool is_direct = staged_filters_.is_direct() && bytes <= opencl::most_direct;
  const cl::CommandQueue& queue = context_.queue();
  if (!is_direct) {
    opencl::Profiler::Scope stage(profiler_, "upload");
    filter_changes_.reserve(context_, bytes, "changes");
    queue.enqueueWriteBuffer(filter_changes_.get(), CL_FALSE, 0, bytes, staged_filters_.host(), nullptr,
                             stage.event());
  }
  opencl::Profiler::Scope stage(profiler_, "apply");
  opencl::set_arguments(apply_filters_.kernel, 0, count,
                        is_direct ? staged_filters_.buffer() : filter_changes_.get(), now_.objects.filters);
  apply_filters_.enqueue(queue, count, stage.event());
}

void DeviceObjects::upload_exclusions(const Input& input) {
  are_exclusions_new_ = input.rules.are_exclusions_new();
  now_.objects.exclusions = are_exclusions_new_ ? cl::Buffer() : last_.objects.exclusions;
  if (!are_exclusions_new_ || input.rules.exclusions.empty()) return;
  const std::size_t count = input.rules.exclusions.size();
  const std::size_t bytes = (count + 1) * sizeof(Pair);
  opencl::GrowingBuffer& buffer = now_.exclusions;
  buffer.reserve(context_, bytes, "exclusions");
  auto* staged = reinterpret_cast<Pair*>(staged_exclusions_.host());
  *staged = {.a = static_cast<std::uint32_t>(count), .b = 0};
  std::ranges::copy(input.rules.exclusions, staged + 1);
  opencl::Profiler::Scope stage(profiler_, "upload");
  context_.queue().enqueueWriteBuffer(buffer.get(), CL_FALSE, 0, bytes, staged, nullptr, stage.event());
  now_.objects.exclusions = buffer.get();
}

/// The boxes of this frame: all from the host, or those of the last frame, to which the changes are applied
/// afterwards.
void DeviceObjects::upload_boxes(const Input& input) {
  const cl::CommandQueue& queue = context_.queue();
  const Generation& last = last_.objects;
  now_.all_uploaded = input.changed.all || last.slots == 0;
  now_.objects.slots = static_cast<cl_uint>(input.boxes.size());
  if (input.arriving != nullptr) return;
  if (now_.all_uploaded) {
    opencl::Profiler::Scope stage(profiler_, "upload");
    queue.enqueueWriteBuffer(now_.objects.boxes, CL_FALSE, 0,
                             std::max<std::size_t>(1, input.boxes.size()) * sizeof(Aabb), boxes_->host(),
                             nullptr, stage.event());
  } else if (last_.all_uploaded) {
    opencl::Profiler::Scope stage(profiler_, "copy");
    queue.enqueueCopyBuffer(last.boxes, now_.objects.boxes, 0, 0, last.slots * sizeof(Aabb), nullptr,
                            stage.event());
  } else if (last_.changed_count > 0) {
    // now_ has the boxes of the frame before the last one.
    opencl::Profiler::Scope stage(profiler_, "copy");
    opencl::set_arguments(copy_.kernel, 0, last_.changed_count, last_.changed.get(), last.boxes,
                          now_.objects.boxes);
    copy_.enqueue(queue, last_.changed_count, stage.event());
  }
}

void DeviceObjects::upload_arriving(const Input& input) {
  if (input.arriving == nullptr) return;
  opencl::Profiler::Scope stage(profiler_, "upload");
  const cl::CommandQueue& queue = context_.queue();
  std::size_t begin = 0;
  do {
    const std::size_t end = input.arriving->next();
    if (end > begin) {
      queue.enqueueWriteBuffer(now_.objects.boxes, CL_FALSE, begin * sizeof(Aabb),
                               (end - begin) * sizeof(Aabb), input.boxes.data() + begin, nullptr,
                               stage.event());
      queue.flush();
    }
    begin = end;
  } while (begin < input.boxes.size());
}

/// Uploads the boxes that changed, and the stamps of this frame. If all changed, only objects that replaced
/// others need a stamp.
void DeviceObjects::upload_changes(const Input& input) {
  const auto new_slots =
      std::ranges::lower_bound(input.changed.recycled, static_cast<std::uint32_t>(last_.objects.slots));
  const std::span<const std::uint32_t> slots =
      input.changed.all ? std::span(input.changed.recycled.begin(), new_slots) : input.changed.slots;
  const auto count = static_cast<cl_uint>(slots.size());
  now_.changed_count = count;
  if (count == 0) return;
  const std::size_t bytes = staged_bytes(count, !input.changed.all);
  const bool is_direct = staged_changes_.is_direct() && bytes <= opencl::most_direct;
  if (!is_direct) changes_.reserve(context_, bytes, "changes");
  if (!input.changed.all) now_.changed.reserve(context_, count * sizeof(cl_uint), "changes");
  auto* words = reinterpret_cast<cl_uint*>(staged_changes_.host());
  auto* boxes = reinterpret_cast<Aabb*>(words + count);
  for (const std::uint32_t slot : slots) {
    const bool recycled = std::ranges::binary_search(input.changed.recycled, slot);
    *words++ = layout::with_recycled(slot, recycled ? 1 : 0);
    if (!input.changed.all) *boxes++ = this->boxes()[slot];
  }
  const cl::CommandQueue& queue = context_.queue();
  if (!is_direct) {
    opencl::Profiler::Scope stage(profiler_, "upload");
    queue.enqueueWriteBuffer(changes_.get(), CL_FALSE, 0, bytes, staged_changes_.host(), nullptr,
                             stage.event());
  }
  opencl::Profiler::Scope stage(profiler_, "apply");
  const cl::Buffer none;
  opencl::set_arguments(apply_.kernel, 0, count, is_direct ? staged_changes_.buffer() : changes_.get(),
                        stamp_, input.changed.all ? none : now_.objects.boxes, stamps_,
                        input.changed.all ? none : now_.changed.get());
  apply_.enqueue(queue, count, stage.event());
}

std::unique_ptr<DeviceObjects> DeviceObjects::successor(std::size_t slots, Frames& frames) const {
  const Generation& last = last_.objects;
  auto next = std::make_unique<DeviceObjects>(context_, profiler_, frames);
  next->reserve_boxes(std::max<std::size_t>(slots, last.slots));
  std::memcpy(next->boxes_->host(), boxes_->host(), slots * sizeof(Aabb));
  const cl::CommandQueue& queue = context_.queue();
  Generation& objects = frames.last.objects;
  objects.slots = last.slots;
  if (last.slots > 0) {
    queue.enqueueCopyBuffer(last.boxes, objects.boxes, 0, 0, last.slots * sizeof(Aabb));
  }
  const auto copy = [&](const cl::Buffer& from, std::size_t bytes, opencl::GrowingBuffer& to) {
    to.reserve(context_, bytes, "objects");
    queue.enqueueCopyBuffer(from, to.get(), 0, 0, bytes);
    return to.get();
  };
  frames.last.filter_count = std::min<std::size_t>(last_.filter_count, last.slots);
  if (last.filters() != nullptr) {
    objects.filters = copy(last.filters, (frames.last.filter_count + Generation::padding) * sizeof(Filter),
                           frames.last.filters.buffer);
  }
  if (last.exclusions() != nullptr) {
    cl_uint count = 0;  // which comes first: kernels/filter.h
    queue.enqueueReadBuffer(last.exclusions, CL_TRUE, 0, sizeof count, &count);
    objects.exclusions =
        copy(last.exclusions, (std::size_t{count} + 1) * sizeof(Pair), frames.last.exclusions);
  }
  return next;
}

Search DeviceObjects::upload(const Input& input) {
  if (stamp_ == layout::LAST_STAMP) {
    opencl::Profiler::Scope stage(profiler_, "clear");
    context_.fill(stamps_, 0, 0, capacity_, stage.event());
    stamp_ = 0;
  }
  ++stamp_;
  upload_filters(input);
  upload_exclusions(input);
  upload_boxes(input);
  upload_changes(input);
  return {.now = now_.objects,
          .last = last_.objects,
          .changed = {.all = input.changed.all,
                      .count = input.changed.all ? 0 : now_.changed_count,
                      .slots = now_.changed.get(),
                      .any_recycled = !input.changed.recycled.empty(),
                      .stamp = stamp_,
                      .stamps = input.changed.all && now_.changed_count == 0 ? cl::Buffer() : stamps_},
          .same_filters =
              !input.rules.all_changed && !input.rules.filters_changed && !input.rules.exclusions_changed,
          .worlds = input.rules.worlds,
          .sets = input.rules.sets};
}

// NOLINTNEXTLINE(bugprone-exception-escape): handles do not throw when moved
void DeviceObjects::commit() noexcept {
  // What the last frame refers to must not be overwritten in the next one.
  if (!are_filters_new_) std::swap(now_.filters, last_.filters);
  if (!are_exclusions_new_) std::swap(now_.exclusions, last_.exclusions);
}

}  // namespace broadcl
