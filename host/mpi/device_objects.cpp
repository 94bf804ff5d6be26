#include "mpi/device_objects.hpp"

#include <cstring>
#include <utility>

#include "base/packed_box.hpp"
#include "mpi/near_parts.hpp"

namespace broadcl::mpi {

void DeviceObjects::set(const DeviceBroadPhase::Boxes& boxes) {
  if (boxes.second.buffer != nullptr || boxes.second.count > 0) {
    throw Error::invalid_argument(
        "objects of several ranks cannot be given in two sets; give filters with groups and masks");
  }
  if (boxes.ordered_worlds != 0) {
    throw Error::invalid_argument("changes of several ranks cannot be sorted by world; sort them yourself");
  }
  core_->refuse_invalid(boxes);
  source_ = boxes;
  boxes_.clear();
  filters_.clear();
}

bool DeviceObjects::begin(const OwnBounds* own, const Neighbours& neighbours, std::vector<Halo>& near) {
  if (own != nullptr) {
    outside_.begin({.buffer = cl::Buffer(source_.buffer, true),
                    .count = source_.count,
                    .offset = source_.offset / sizeof(float),
                    .stride = (source_.stride == 0 ? sizeof(Aabb) : source_.stride) / sizeof(float)},
                   cl::Buffer(source_.filters, true), neighbours.interior());
  }
  core_->begin(source_);
  if (own == nullptr) return true;
  NearParts parts(*own, neighbours, outside_.finish(), threads_);
  parts.find_all([&](std::size_t k) {
    const BoxesOutside::Found found = outside_[k];
    return Placed{.id = found.index, .box = found.box};
  });
  return parts.join(
      [&](std::size_t k) {
        const BoxesOutside::Found found = outside_[k];
        return Labelled{.id = found.index, .filter = found.filter};
      },
      near);
}

std::span<const Aabb> DeviceObjects::boxes() {
  if (!boxes_.empty() || source_.count == 0) return boxes_;
  const std::size_t stride = source_.stride == 0 ? sizeof(Aabb) : source_.stride;
  std::vector<std::byte> bytes((source_.count - 1) * stride + sizeof(Aabb));
  std::vector<Aabb> boxes(source_.count);
  core_->read(source_.buffer, source_.offset, bytes);
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    std::memcpy(&boxes[k], bytes.data() + k * stride, sizeof(Aabb));
    boxes[k] = pack(boxes[k]);
  }
  boxes_ = std::move(boxes);
  return boxes_;
}

std::span<const Filter> DeviceObjects::filters() {
  if (source_.filters == nullptr || !filters_.empty()) return filters_;
  std::vector<Filter> filters(source_.count);
  core_->read(source_.filters, 0, std::as_writable_bytes(std::span(filters)));
  filters_ = std::move(filters);
  return filters_;
}

}  // namespace broadcl::mpi
