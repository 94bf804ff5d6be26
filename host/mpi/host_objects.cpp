#include "mpi/host_objects.hpp"

#include <algorithm>
#include <exception>
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "mpi/near_parts.hpp"
#include "mpi/pending_changes.hpp"

namespace broadcl::mpi {
void HostObjects::reserve(std::size_t ids) {
  if (ids <= reserved_) return;
  const std::size_t more = std::max(ids, 2 * reserved_);
  changes_.reserve(more);
  reserved_ = more;
}

std::uint32_t HostObjects::add(const Aabb& box, const Filter& filter) {
  reserve(ids_ + 1);
  const std::uint32_t id = search_.add(box, filter);
  // Nothing below throws.
  changes_.recycle(id);
  ids_ = std::max(ids_, std::size_t{id} + 1);
  return id;
}

void HostObjects::move(std::uint32_t id, const Aabb& box) {
  search_.move(id, box);
  changes_.insert(id);
}

void HostObjects::set_filter(std::uint32_t id, const Filter& filter) {
  search_.set_filter(id, filter);
  changes_.insert(id);
}

void HostObjects::remove(std::uint32_t id) {
  search_.remove(id);
  changes_.insert(id);
}

std::span<Aabb> HostObjects::map(std::size_t n) {
  search_.refuse_replacement(n);
  reserve(n);
  const bool has_holes = search_.size() != n || ids_ != n;
  for (std::uint32_t id = 0; has_holes && id < n; ++id) {
    if (!search_.contains(id)) changes_.recycle(id);  // if the next line throws, that does no harm
  }
  const std::span<Aabb> boxes = search_.map(n);
  changes_.all = true;
  ids_ = n;
  return boxes;
}

bool HostObjects::begin(const OwnBounds* own, const Neighbours& neighbours, std::vector<Halo>& near) {
  deltas_.reserve(deltas_.size() + 1);
  changed_.assign(changes_.changed().begin(), changes_.changed().end());
  std::ranges::sort(changed_);
  std::optional<NearParts> parts;
  if (own != nullptr) parts.emplace(*own, neighbours, ids_, threads_);
  search_.begin([&](std::size_t begin, std::size_t end, std::span<const Aabb> all) {
    if (parts) parts->find(begin, end, [&](std::size_t id) { return placed(id, all); });
  });
  search_.flush();
  is_begun_ = true;
  changes_.sort_recycled();
  if (!parts) return true;
  if (parts->has_seen_all())
    return parts->join([&](std::size_t id) { return labelled(id, filters()); }, near);
  if (have_all_changed()) return find_near(*own, neighbours, boxes(), filters(), threads_, near);
  NearParts some(*own, neighbours, changed_.size(), threads_);
  some.find_all([&](std::size_t k) { return placed(changed_[k], boxes()); });
  return some.join([&](std::size_t k) { return labelled(changed_[k], filters()); }, near);
}

Delta HostObjects::finish() {
  is_begun_ = false;
  deltas_.push_back(search_.finish());  // within its capacity
  if (deltas_.size() == 1) return deltas_.front();
  const auto lists = std::make_shared<PairLists>(combined(deltas_, changes_.recycled()));
  return {.added = lists->added, .removed = lists->removed, .owner = lists};
}

void HostObjects::abandon() noexcept {
  if (!std::exchange(is_begun_, false)) return;
  try {
    deltas_.push_back(search_.finish());
  } catch (const std::exception&) {  // its changes are not lost
  }
}

void HostObjects::commit() noexcept {
  deltas_.clear();
  changes_.clear();
}

std::vector<Pair> HostObjects::pairs() const {
  std::vector<Pair> pairs = search_.pairs();
  return deltas_.empty() ? pairs : undone(deltas_, pairs);
}

bool HostObjects::have_all_changed() const {
  return changes_.all || 4 * changes_.changed().size() > ids_;
}

}  // namespace broadcl::mpi
