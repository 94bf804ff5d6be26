#include "algorithms/device_objects.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <utility>

#include "opencl/error.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

/// As kernels/changes.cl reads it.
struct Change {
  cl_uint slot_and_renewed;
  Aabb box;
};
static_assert(sizeof(Change) == 28);

constexpr std::size_t group = 64;
constexpr std::size_t most_slots = std::size_t{1} << 31;  // a slot and a bit share a word
constexpr cl_uint last_stamp = 0x7fffffff;

}  // namespace

DeviceObjects::DeviceObjects(const opencl::Context& context, opencl::Profiler& profiler)
    : context_(context), profiler_(profiler) {
  const cl::Program program = context.program("changes.cl");
  opencl::translate_errors(context.device().label(), [&] {
    apply_ = cl::Kernel(program, "apply_changes");
    copy_ = cl::Kernel(program, "copy_boxes");
  });
  reserve(1);
}

void DeviceObjects::reserve(std::size_t slots) {
  if (slots <= boxes().size()) return;
  if (slots > most_slots)
    throw Error(context_.device().label() + ": more than 2147483648 objects; use fewer");
  opencl::translate_errors(context_.device().label(), [&] {
    const std::size_t capacity =
        std::min(most_slots, std::max({slots, boxes().size() * 3 / 2, std::size_t{256}}));
    const std::size_t bytes = (capacity + Search::padding) * sizeof(Aabb);
    opencl::PinnedBuffer boxes(context_, bytes);
    cl::Buffer last = context_.buffer(bytes);
    cl::Buffer next = context_.buffer(bytes);
    cl::Buffer stamps = context_.buffer(capacity * sizeof(cl_uint));
    context_.queue().enqueueFillBuffer(stamps, cl_uint{0}, 0, capacity * sizeof(cl_uint));
    if (last_.slots > 0) {
      context_.queue().enqueueCopyBuffer(last_.boxes, last, 0, 0, last_.slots * sizeof(Aabb));
    }
    if (boxes_.bytes() > 0) std::memcpy(boxes.host(), boxes_.host(), boxes_.bytes());
    boxes_ = std::move(boxes);
    last_.boxes = std::move(last);
    last_.all = true;  // next_ has none of them
    next_.boxes = std::move(next);
    stamps_ = std::move(stamps);
  });
}

std::span<Aabb> DeviceObjects::boxes() const noexcept {
  const std::size_t boxes = boxes_.bytes() / sizeof(Aabb);
  return {reinterpret_cast<Aabb*>(boxes_.host()), boxes == 0 ? 0 : boxes - Search::padding};
}

void DeviceObjects::upload_filters(const Changes& changes) {
  const std::size_t count = changes.filters.size();
  are_filters_new_ = changes.filters_changed || count > last_.filter_count;
  if (!are_filters_new_) return;
  next_.filter_count = count;
  if (count == 0) return;
  if (next_.filter_capacity < count) {
    next_.filter_capacity = 0;
    const std::size_t capacity = boxes().size();
    next_.filters = context_.buffer((capacity + Search::padding) * sizeof(Filter));
    next_.filter_capacity = capacity;
  }
  // Blocking, since the caller may change them during the update.
  context_.queue().enqueueWriteBuffer(next_.filters, CL_TRUE, 0, changes.filters.size_bytes(),
                                      changes.filters.data());
}

/// The boxes of this update: all from the host, or those of the last update, which then are changed.
void DeviceObjects::upload_boxes(const Changes& changes) {
  const cl::CommandQueue& queue = context_.queue();
  next_.all = changes.all || last_.slots == 0;
  next_.slots = static_cast<cl_uint>(changes.slots);
  if (next_.all) {
    opencl::Profiler::Scope stage(profiler_, "upload");
    queue.enqueueWriteBuffer(next_.boxes, CL_FALSE, 0, std::max<std::size_t>(1, changes.slots) * sizeof(Aabb),
                             boxes_.host(), nullptr, stage.event());
  } else if (last_.all) {
    opencl::Profiler::Scope stage(profiler_, "copy");
    queue.enqueueCopyBuffer(last_.boxes, next_.boxes, 0, 0, last_.slots * sizeof(Aabb), nullptr,
                            stage.event());
  } else if (last_.changed_count > 0) {
    // The boxes of next_ are those of the update before the last one.
    opencl::Profiler::Scope stage(profiler_, "copy");
    opencl::set_arguments(copy_, 0, last_.changed_count, last_.changed, last_.boxes, next_.boxes);
    queue.enqueueNDRangeKernel(copy_, cl::NullRange,
                               cl::NDRange(opencl::round_up(last_.changed_count, group)), cl::NDRange(group),
                               nullptr, stage.event());
  }
}

/// Boxes that changed, and the stamps of this update. Of `all`, only whose object is another one needs a
/// stamp.
void DeviceObjects::upload_changes(const Changes& changes) {
  const std::span<const std::uint32_t> slots = changes.all ? changes.renewed : changes.changed;
  next_.changed_count = 0;
  if (slots.empty()) return;
  const cl::CommandQueue& queue = context_.queue();
  const std::size_t capacity = slots.size() + slots.size() / 2;
  if (staged_changes_.bytes() < slots.size() * sizeof(Change)) {
    opencl::PinnedBuffer staged(context_, capacity * sizeof(Change));
    changes_ = context_.buffer(capacity * sizeof(Change));
    staged_changes_ = std::move(staged);
  }
  if (next_.changed_capacity < slots.size()) {
    next_.changed_capacity = 0;
    next_.changed = context_.buffer(capacity * sizeof(cl_uint));
    next_.changed_capacity = capacity;
  }
  auto* out = reinterpret_cast<Change*>(staged_changes_.host());
  for (const std::uint32_t slot : slots) {
    const bool renewed = std::binary_search(changes.renewed.begin(), changes.renewed.end(), slot);
    *out++ = {.slot_and_renewed = slot << 1 | (renewed ? 1U : 0U), .box = boxes()[slot]};
  }
  const auto count = static_cast<cl_uint>(slots.size());
  {
    opencl::Profiler::Scope stage(profiler_, "upload");
    queue.enqueueWriteBuffer(changes_, CL_FALSE, 0, count * sizeof(Change), staged_changes_.host(), nullptr,
                             stage.event());
  }
  opencl::Profiler::Scope stage(profiler_, "apply");
  opencl::set_arguments(apply_, 0, count, changes_, stamp_, next_.boxes, stamps_, next_.changed);
  queue.enqueueNDRangeKernel(apply_, cl::NullRange, cl::NDRange(opencl::round_up(count, group)),
                             cl::NDRange(group), nullptr, stage.event());
  next_.changed_count = count;
}

Search DeviceObjects::upload(const Changes& changes) {
  if (stamp_ == last_stamp) {
    context_.queue().enqueueFillBuffer(stamps_, cl_uint{0}, 0, boxes().size() * sizeof(cl_uint));
    stamp_ = 0;
  }
  ++stamp_;
  upload_filters(changes);
  upload_boxes(changes);
  upload_changes(changes);
  const Generation& filters = are_filters_new_ ? next_ : last_;
  // A buffer that is not read stands where there are no filters.
  return {.slots = next_.slots,
          .boxes = next_.boxes,
          .filters = changes.filters.empty() ? stamps_ : filters.filters,
          .any_filters = !changes.filters.empty(),
          .worlds = changes.worlds,
          .all = changes.all,
          .changed_count = changes.all ? 0 : next_.changed_count,
          .changed = next_.changed() == nullptr ? stamps_ : next_.changed,
          .stamps = {.words = stamps_, .stamp = stamp_, .any_renewed = !changes.renewed.empty()},
          .last_slots = last_.slots,
          .last_boxes = last_.boxes,
          .last_filters = last_.filter_count == 0 ? stamps_ : last_.filters,
          .any_last_filters = last_.filter_count > 0,
          .same_filters = !are_filters_new_};
}

void DeviceObjects::commit() {
  std::swap(last_, next_);
  if (are_filters_new_) return;
  std::swap(last_.filters, next_.filters);
  std::swap(last_.filter_capacity, next_.filter_capacity);
  std::swap(last_.filter_count, next_.filter_count);
}

}  // namespace broadcl
