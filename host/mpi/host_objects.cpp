#include "mpi/host_objects.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <memory>
#include <utility>

#include "base/box_parts.hpp"
#include "base/packed_box.hpp"
#include "mpi/pending_changes.hpp"

namespace broadcl::mpi {
namespace {

constexpr std::size_t sample_size = 4096;

}  // namespace

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
  mapped_ = {};
  changes_.recycle(id);
  ids_ = std::max(ids_, std::size_t{id} + 1);
  return id;
}

void HostObjects::move(std::uint32_t id, const Aabb& box) {
  search_.move(id, box);
  mapped_ = {};
  changes_.insert(id);
}

void HostObjects::set_filter(std::uint32_t id, const Filter& filter) {
  search_.set_filter(id, filter);
  changes_.insert(id);
}

void HostObjects::remove(std::uint32_t id) {
  search_.remove(id);
  mapped_ = {};
  changes_.insert(id);
}

std::span<Aabb> HostObjects::map(std::size_t n) {
  reserve(n);
  const bool has_holes = search_.size() != n || ids_ != n;
  for (std::uint32_t id = 0; has_holes && id < n; ++id) {
    if (!search_.contains(id)) changes_.recycle(id);  // if the next line throws, that does no harm
  }
  mapped_ = search_.map(n);
  changes_.all = true;
  ids_ = n;
  return mapped_;
}

void HostObjects::begin() {
  deltas_.reserve(deltas_.size() + 1);
  changed_.assign(changes_.changed().begin(), changes_.changed().end());
  std::ranges::sort(changed_);
  search_.begin();
  changes_.sort_recycled();
  is_begun_ = true;
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
  mapped_ = {};
}

std::vector<Pair> HostObjects::pairs() const {
  std::vector<Pair> pairs = search_.pairs();
  return deltas_.empty() ? pairs : undone(deltas_, pairs);
}

Aabb HostObjects::box(std::uint32_t id) const {
  return search_.contains(id) ? pack(search_.box(id)) : packed_empty();
}

/// Calls function(box_of), which returns packed boxes.
template <class Function>
void HostObjects::with_boxes(const Function& function) const {
  if (mapped_.empty()) {
    function([this](std::uint32_t id) { return box(id); });
  } else {
    function([boxes = mapped_.data()](std::uint32_t id) -> const Aabb& {
      return boxes[id];
    });  // begin() has packed them
  }
}

std::vector<Aabb> HostObjects::sample() {
  std::vector<Aabb> boxes;
  const auto stride = static_cast<std::uint32_t>(ids_ / sample_size + 1);
  for (std::uint32_t id = 0; id < ids_; id += stride) {
    const Aabb one = box(id);
    if (is_proper(one)) boxes.push_back(one);
  }
  return boxes;
}

Survey HostObjects::survey(const Grid& grid) {
  // By part, so that the ids of objects that are alone do not depend on the threads.
  constexpr std::size_t most_parts = 32;
  const std::size_t parts = std::min(most_parts, parts_of(ids_));
  std::vector<Survey> surveys(parts);
  with_boxes([&](const auto& box_of) {
    const std::size_t threads = useful_threads(ids_, boxes_per_part, threads_);
    parallel_for(parts, threads, [&](std::size_t part, std::size_t /*thread*/) {
      const auto end = static_cast<std::uint32_t>(ids_ * (part + 1) / parts);
      for (auto id = static_cast<std::uint32_t>(ids_ * part / parts); id < end; ++id) {
        const Aabb one = box_of(id);
        if (is_proper(one)) surveys[part].add(grid, id, one);
      }
    });
  });
  Survey all;
  for (const Survey& survey : surveys) all.add(grid, survey);
  return all;
}

bool HostObjects::have_all_changed() const {
  return changes_.all || 4 * changes_.changed().size() > ids_;
}

bool HostObjects::find_near(const OwnBounds& bounds, const Neighbours& neighbours, bool all,
                            std::vector<std::vector<std::uint32_t>>& near) {
  struct Near {
    std::uint32_t halo, id;
  };
  const std::size_t count = all ? ids_ : changed_.size();
  std::vector<std::vector<Near>> parts(parts_of(count));
  const Corners interior(neighbours.interior());
  std::atomic<bool> are_inside = true;
  with_boxes([&](const auto& box_of) {
    const std::size_t threads = useful_threads(count, 2 * boxes_per_part, threads_);
    parallel_for(parts.size(), threads, [&](std::size_t part, std::size_t /*thread*/) {
      std::vector<Near> found;
      const std::size_t end = std::min(count, (part + 1) * boxes_per_part);
      for (std::size_t k = part * boxes_per_part; k < end; ++k) {
        const std::uint32_t id = all ? static_cast<std::uint32_t>(k) : changed_[k];
        const Aabb& box = box_of(id);
        const Corners corners(box);
        if (contains(interior, corners)) continue;
        const std::size_t place = bounds.place_of(id, corners);
        if (place == OwnBounds::outside) {
          if (is_proper(box)) are_inside = false;
          continue;
        }
        neighbours.for_each_halo(place, corners, [&](std::uint32_t halo) { found.push_back({halo, id}); });
      }
      parts[part] = std::move(found);
    });
  });
  for (std::vector<std::uint32_t>& halo : near) halo.clear();
  for (const std::vector<Near>& part : parts) {
    for (const auto& [halo, id] : part) near[halo].push_back(id);
  }
  return are_inside;
}

void HostObjects::describe(Halo& halo) {
  with_boxes([&](const auto& box_of) {
    for_each_part(halo.ids.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
      for (std::size_t k = begin; k < end; ++k) {
        halo.boxes[k] = box_of(halo.ids[k]);
        halo.filters[k] = search_.filter(halo.ids[k]);
      }
    });
  });
}

}  // namespace broadcl::mpi
