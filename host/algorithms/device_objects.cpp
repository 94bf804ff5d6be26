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
    filters_ = opencl::SharedBuffer(context, sizeof(Filter));
    changes_ = opencl::SharedBuffer(context, sizeof(Change));
    changed_ = cl::Buffer(context.context(), CL_MEM_READ_WRITE, sizeof(cl_uint));
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
    opencl::SharedBuffer larger(context_, (capacity + Search::padding) * sizeof(Aabb));
    cl::Buffer stamps(context_.context(), CL_MEM_READ_WRITE, capacity * sizeof(cl_uint));
    context_.queue().enqueueFillBuffer(stamps, cl_uint{0}, 0, capacity * sizeof(cl_uint));
    if (boxes_.bytes() > 0) std::memcpy(larger.host(), boxes_.host(), boxes_.bytes());
    boxes_ = std::move(larger);
    is_device_behind_ = true;
    stamps_ = std::move(stamps);
  });
}

void DeviceObjects::reclaim_what_failed() {
  const auto is_lost = [](const opencl::SharedBuffer& buffer) {
    return buffer.bytes() > 0 && buffer.host() == nullptr;
  };
  if (!is_lost(boxes_) && !is_lost(filters_) && !is_lost(changes_)) return;
  opencl::translate_errors(context_.device().label(), [&] {
    reclaim();
    opencl::wait_for_all(context_.queue());
  });
}

std::span<Aabb> DeviceObjects::boxes() {
  reclaim_what_failed();
  const std::size_t boxes = boxes_.bytes() / sizeof(Aabb);
  return {reinterpret_cast<Aabb*>(boxes_.host()), boxes == 0 ? 0 : boxes - Search::padding};
}

void DeviceObjects::upload_filters(const Changes& changes) {
  const std::size_t count = changes.filters.size();
  if (count == 0 || (!changes.filters_changed && count <= filter_count_)) return;
  const std::size_t bytes = changes.filters.size_bytes();
  if (filters_.bytes() < bytes + Search::padding * sizeof(Filter)) {
    filters_ =
        opencl::SharedBuffer(context_, boxes().size() * sizeof(Filter) + Search::padding * sizeof(Filter));
  }
  std::memcpy(filters_.host(), changes.filters.data(), bytes);
  filters_.upload(bytes);
  filter_count_ = count;
}

/// Boxes that changed, and the stamps of this update. Of `all`, only whose object is another one needs a
/// stamp.
cl_uint DeviceObjects::upload_changes(const Changes& changes) {
  const std::span<const std::uint32_t> slots = changes.all ? changes.renewed : changes.changed;
  if (slots.empty()) return 0;
  if (changes_.bytes() < slots.size() * sizeof(Change)) {
    const std::size_t capacity = slots.size() + slots.size() / 2;
    opencl::SharedBuffer larger(context_, capacity * sizeof(Change));
    changed_ = cl::Buffer(context_.context(), CL_MEM_READ_WRITE, capacity * sizeof(cl_uint));
    changes_ = std::move(larger);
  }
  auto* out = reinterpret_cast<Change*>(changes_.host());
  for (const std::uint32_t slot : slots) {
    const bool renewed = std::binary_search(changes.renewed.begin(), changes.renewed.end(), slot);
    *out++ = {.slot_and_renewed = slot << 1 | (renewed ? 1U : 0U), .box = boxes()[slot]};
  }
  opencl::Profiler::Scope stage(profiler_, "upload");
  changes_.upload(slots.size() * sizeof(Change), stage.event());
  return static_cast<cl_uint>(slots.size());
}

void DeviceObjects::apply_changes(cl_uint count) {
  if (count == 0) return;
  opencl::Profiler::Scope stage(profiler_, "apply");
  opencl::set_arguments(apply_, 0, count, changes_.device(), stamp_, boxes_.device(), stamps_, changed_);
  context_.queue().enqueueNDRangeKernel(apply_, cl::NullRange, cl::NDRange(opencl::round_up(count, group)),
                                        cl::NDRange(group), nullptr, stage.event());
}

Search DeviceObjects::upload(const Changes& changes) {
  reclaim_what_failed();
  if (stamp_ == last_stamp) {
    context_.queue().enqueueFillBuffer(stamps_, cl_uint{0}, 0, boxes().size() * sizeof(cl_uint));
    stamp_ = 0;
  }
  ++stamp_;
  upload_filters(changes);
  const cl_uint count = upload_changes(changes);
  if (changes.all || is_device_behind_) {
    opencl::Profiler::Scope stage(profiler_, "upload");
    boxes_.upload(std::max<std::size_t>(1, changes.slots) * sizeof(Aabb), stage.event());
    is_device_behind_ = false;
  } else {
    boxes_.lend();
  }
  apply_changes(count);
  return {.slots = static_cast<cl_uint>(changes.slots),
          .boxes = boxes_.device(),
          .filters = filters_.device(),
          .any_filters = !changes.filters.empty(),
          .worlds = changes.worlds,
          .all = changes.all,
          .changed_count = changes.all ? 0 : count,
          .changed = changed_,
          .stamps = {.words = stamps_, .stamp = stamp_, .any_renewed = !changes.renewed.empty()}};
}

void DeviceObjects::reclaim() {
  boxes_.reclaim();
  filters_.reclaim();
  changes_.reclaim();
}

void DeviceObjects::give_up() noexcept {
  try {
    reclaim();
    opencl::wait_for_all(context_.queue());
  } catch (const cl::Error&) {
    // What failed first is what the caller is told.
    return;
  }
}

void DeviceObjects::lend() {
  boxes_.lend();
  filters_.lend();
  changes_.lend();
}

}  // namespace broadcl
