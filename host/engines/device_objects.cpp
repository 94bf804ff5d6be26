#include "engines/device_objects.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <limits>
#include <string>
#include <utility>
#include <vector>

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
  auto staged = share(context, opencl::MappedBuffer::pinned(context, bytes));
  std::fill_n(reinterpret_cast<Aabb*>(staged->host()), bytes / sizeof(Aabb), packed_empty());
  return staged;
}

/// Bytes of staged changes: one word each, with or without boxes, filters and reaches.
std::size_t staged_bytes(std::size_t changes, bool boxes, bool filters, bool reaches) {
  return changes * (sizeof(cl_uint) + (boxes ? sizeof(Aabb) : 0) + (filters ? sizeof(Filter) : 0) +
                    (reaches ? sizeof(float) : 0));
}

}  // namespace

DeviceObjects::DeviceObjects(const opencl::Context& context, opencl::Profiler& profiler, Frames& frames)
    : context_(context), profiler_(profiler), now_(frames.now), last_(frames.last) {
  const cl::Program program = opencl::common_program(context);
  apply_ = context.sized_kernel(program, "apply_changes");
  copy_ = context.sized_kernel(program, "copy_objects");
  grow_ = context.sized_kernel(program, "grow_boxes");
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
  // An update has at most a quarter of the slots in `changed`, or all slots recycled, without anything else.
  const std::size_t staged =
      std::max(staged_bytes(capacity / 4 + 1, true, true, true), staged_bytes(capacity, false, false, false));
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

/// Prepares the boxes of this frame to be grown, if there are reaches.
void DeviceObjects::prepare_reaches(const Input& input) {
  now_.objects.ungrown = cl::Buffer();
  if (input.rules.reaches.empty() || input.boxes.empty()) return;
  const std::size_t bytes = (capacity_ + Generation::padding) * sizeof(cl_float8);
  if (now_.ungrown.bytes() < bytes) last_.all_uploaded = true;  // now_ has none of them
  now_.ungrown.reserve(context_, bytes, "boxes");
  now_.objects.ungrown = now_.ungrown.get();
  if (last_.objects.ungrown() == nullptr) now_.all_uploaded = true;
  if (staged_reaches_.bytes() >= capacity_ * sizeof(float)) return;
  staged_reaches_ = opencl::MappedBuffer::pinned(context_, capacity_ * sizeof(float));
  std::fill_n(reinterpret_cast<float*>(staged_reaches_.host()), capacity_,
              std::numeric_limits<float>::quiet_NaN());
  now_.all_uploaded = true;
}

/// Grows all boxes of this frame, which were uploaded.
void DeviceObjects::grow_boxes(const Input& input) {
  if (now_.objects.ungrown() == nullptr) return;
  const Generation& last = last_.objects;
  const std::span<const float> reaches = input.rules.reaches.first(input.boxes.size());
  const std::span staged(reinterpret_cast<float*>(staged_reaches_.host()), reaches.size());
  const bool same = !input.rules.all_changed && last.ungrown() != nullptr && reaches.size() <= last.slots &&
                    std::ranges::equal(reaches, staged);
  if (!same) {
    reaches_.reserve(context_, reaches.size_bytes(), "reaches");
    std::ranges::copy(reaches, staged.begin());
    opencl::Profiler::Scope stage(profiler_, "upload");
    context_.queue().enqueueWriteBuffer(reaches_.get(), CL_FALSE, 0, staged.size_bytes(), staged.data(),
                                        nullptr, stage.event());
  }
  opencl::Profiler::Scope stage(profiler_, "grow");
  opencl::set_arguments(grow_.kernel, 0, now_.objects.slots, same ? cl::Buffer() : reaches_.get(),
                        last.ungrown, now_.objects.boxes, now_.objects.ungrown);
  grow_.enqueue(context_.queue(), now_.objects.slots, stage.event());
}

/// The filters of this frame: all from the host, or those of the last frame.
/// @returns Whether they are a copy, to which changes are applied afterwards.
bool DeviceObjects::upload_filters(const Input& input) {
  const PairRules& rules = input.rules;
  const auto recycled = input.changed.recycled;
  const Generation& last = last_.objects;
  now_.objects.filters = cl::Buffer();
  if (rules.filters.empty()) return false;
  const bool any_new = !recycled.empty() && recycled.back() >= last.slots;
  const bool all =
      rules.all_changed || last.filters() == nullptr || last.slots == 0 ||
      (input.changed.all && recycled.size() + rules.refiltered.size() > rules.filters.size() / 4);
  if (input.changed.all && !all && rules.refiltered.empty() && !any_new) {
    now_.objects.filters = last.filters;
    return false;
  }
  const std::size_t bytes = (capacity_ + Generation::padding) * sizeof(Filter);
  const bool grows = now_.filters.bytes() < bytes;
  now_.filters.reserve(context_, bytes, "filters");
  now_.objects.filters = now_.filters.get();
  const cl::CommandQueue& queue = context_.queue();
  if (all) {
    now_.all_uploaded = true;
    opencl::Profiler::Scope stage(profiler_, "upload");
    std::memcpy(staged_filters_.host(), rules.filters.data(), rules.filters.size_bytes());
    queue.enqueueWriteBuffer(now_.filters.get(), CL_FALSE, 0, rules.filters.size_bytes(),
                             staged_filters_.host(), nullptr, stage.event());
  } else if (grows || now_.all_uploaded || last_.all_uploaded) {
    opencl::Profiler::Scope stage(profiler_, "copy");
    queue.enqueueCopyBuffer(last.filters, now_.filters.get(), 0, 0, last.slots * sizeof(Filter), nullptr,
                            stage.event());
  }
  return !all;
}

void DeviceObjects::upload_exclusions(const Input& input) {
  const bool are_new = input.rules.are_exclusions_new();
  now_.objects.exclusions = are_new ? cl::Buffer() : last_.objects.exclusions;
  if (!are_new || input.rules.exclusions.empty()) return;
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
/// @param with_filters The same for filters.
void DeviceObjects::upload_boxes(const Input& input, bool with_filters) {
  const cl::CommandQueue& queue = context_.queue();
  const Generation& last = last_.objects;
  if (input.arriving != nullptr) return;
  if (now_.all_uploaded) {
    opencl::Profiler::Scope stage(profiler_, "upload");
    queue.enqueueWriteBuffer(now_.objects.boxes, CL_FALSE, 0,
                             std::max<std::size_t>(1, input.boxes.size()) * sizeof(Aabb), boxes_->host(),
                             nullptr, stage.event());
    grow_boxes(input);
  } else if (last_.all_uploaded) {
    opencl::Profiler::Scope stage(profiler_, "copy");
    queue.enqueueCopyBuffer(last.boxes, now_.objects.boxes, 0, 0, last.slots * sizeof(Aabb), nullptr,
                            stage.event());
    if (now_.objects.ungrown() == nullptr) return;
    queue.enqueueCopyBuffer(last.ungrown, now_.objects.ungrown, 0, 0, last.slots * sizeof(cl_float8), nullptr,
                            stage.event());
  } else if (last_.changed_count > 0) {
    // now_ has those of the frame before the last one.
    opencl::Profiler::Scope stage(profiler_, "copy");
    opencl::set_arguments(
        copy_.kernel, 0, last_.changed_count, last_.changed.get(), last.boxes, now_.objects.boxes,
        last.filters, with_filters ? now_.objects.filters : cl::Buffer(), last.ungrown, now_.objects.ungrown);
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
  grow_boxes(input);
}

/// Uploads the objects that changed, and the stamps of this frame. If all changed, only objects that replaced
/// others need a stamp.
/// @param with_filters Whether their filters are uploaded, too.
void DeviceObjects::upload_changes(const Input& input, bool with_filters) {
  const bool all = input.changed.all;
  const auto recycled = input.changed.recycled;
  const auto is_recycled = [&](std::uint32_t slot) { return std::ranges::binary_search(recycled, slot); };
  std::vector<std::uint32_t> of_all;
  if (all) {
    const auto new_slots =
        std::ranges::lower_bound(recycled, static_cast<std::uint32_t>(last_.objects.slots));
    of_all.assign(recycled.begin(), with_filters ? recycled.end() : new_slots);
  }
  if (all && with_filters) {
    std::ranges::remove_copy_if(input.rules.refiltered, std::back_inserter(of_all), is_recycled);
  }
  const std::span<const std::uint32_t> changed = all ? of_all : input.changed.slots;
  const auto count = static_cast<cl_uint>(changed.size());
  now_.changed_count = count;
  if (count == 0) return;
  const bool with_reaches = !all && now_.objects.ungrown() != nullptr;
  const std::size_t bytes = staged_bytes(count, !all, with_filters, with_reaches);
  const bool is_direct = staged_changes_.is_direct() && bytes <= opencl::most_direct;
  if (!is_direct) changes_.reserve(context_, bytes, "changes");
  if (!all) now_.changed.reserve(context_, count * sizeof(cl_uint), "changes");
  auto* words = reinterpret_cast<cl_uint*>(staged_changes_.host());
  auto* boxes = reinterpret_cast<Aabb*>(words + count);
  auto* reaches = reinterpret_cast<float*>(boxes + (all ? 0 : count));
  auto* filters = reinterpret_cast<Filter*>(reaches + (with_reaches ? count : 0));
  auto* staged_reaches = reinterpret_cast<float*>(staged_reaches_.host());
  for (const std::uint32_t slot : changed) {
    *words++ = layout::with_recycled(slot, is_recycled(slot) ? 1 : 0);
    if (!all) *boxes++ = this->boxes()[slot];
    if (with_reaches) *reaches++ = staged_reaches[slot] = input.rules.reaches[slot];
    if (with_filters) *filters++ = input.rules.filters[slot];
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
                        stamp_, all ? none : now_.objects.boxes, with_filters ? now_.objects.filters : none,
                        stamps_, all ? none : now_.changed.get(), all ? none : now_.objects.ungrown);
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
  if (last.filters() != nullptr) {
    objects.filters =
        copy(last.filters, (last.slots + Generation::padding) * sizeof(Filter), frames.last.filters);
  }
  if (last.ungrown() != nullptr) {
    objects.ungrown =
        copy(last.ungrown, (last.slots + Generation::padding) * sizeof(cl_float8), frames.last.ungrown);
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
  now_.all_uploaded = input.changed.all || last_.objects.slots == 0;
  now_.objects.slots = static_cast<cl_uint>(input.boxes.size());
  prepare_reaches(input);
  const bool with_filters = upload_filters(input);
  upload_exclusions(input);
  upload_boxes(input, with_filters);
  upload_changes(input, with_filters);
  return {.now = now_.objects,
          .last = last_.objects,
          .changed = {.all = input.changed.all,
                      .count = input.changed.all ? 0 : now_.changed_count,
                      .slots = now_.changed.get(),
                      .recycled = static_cast<cl_uint>(input.changed.recycled.size()),
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
  if (last_.objects.filters() != last_.filters.get()()) std::swap(now_.filters, last_.filters);
  if (last_.objects.exclusions() != last_.exclusions.get()()) std::swap(now_.exclusions, last_.exclusions);
}

}  // namespace broadcl
