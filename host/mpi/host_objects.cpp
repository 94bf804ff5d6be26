#include "mpi/host_objects.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "base/box_parts.hpp"
#include "base/packed_box.hpp"
#include "mpi/pending_changes.hpp"

namespace broadcl::mpi {
namespace {

constexpr std::size_t sample_size = 4096;

/// Finds the objects that belong to halos, part by part: see for_each_part().
class NearParts {
 public:
  NearParts(const OwnBounds& own, const Neighbours& neighbours, std::size_t objects)
      : own_(own), neighbours_(neighbours), parts_(parts_of(objects)) {}

  /// May be called for several parts at the same time.
  /// @param begin, end Of the part.
  /// @param id_of Gives the id of an object.
  template <class IdOf>
  void find(std::size_t begin, std::size_t end, const IdOf& id_of, std::span<const Aabb> boxes) {
    std::vector<Near> found;
    bool are_inside = true;
    for (std::size_t k = begin; k < end; ++k) {
      const std::uint32_t id = id_of(k);
      are_inside &= neighbours_.for_each_halo(own_, id, boxes[id], [&](std::uint32_t halo) {
        found.push_back({.halo = halo, .id = id, .box = boxes[id]});
      });
    }
    if (!are_inside) are_inside_ = false;
    parts_[begin / boxes_per_part] = std::move(found);
    objects_ += end - begin;
  }
  /// In how many objects it has looked.
  [[nodiscard]] std::size_t objects() const noexcept { return objects_; }
  /// @param filters By id; none if all are the default one.
  /// @returns Whether the bounds contain all of them.
  bool join(std::span<const Filter> filters, std::vector<Halo>& near) const {
    for (Halo& halo : near) halo.clear();
    for (const std::vector<Near>& part : parts_) {
      for (const auto& [halo, id, box] : part) {
        near[halo].add(id, box, filters.empty() ? Filter() : filters[id]);
      }
    }
    return are_inside_;
  }

 private:
  struct Near {
    std::uint32_t halo, id;
    Aabb box;
  };

  const OwnBounds& own_;
  const Neighbours& neighbours_;
  std::vector<std::vector<Near>> parts_;
  std::atomic<bool> are_inside_ = true;
  std::atomic<std::size_t> objects_ = 0;
};

std::uint32_t same(std::size_t id) {
  return static_cast<std::uint32_t>(id);
}

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
  if (own != nullptr) parts.emplace(*own, neighbours, ids_);
  search_.begin([&](std::size_t begin, std::size_t end, std::span<const Aabb> boxes) {
    if (parts) parts->find(begin, end, same, boxes);
  });
  search_.flush();
  is_begun_ = true;
  changes_.sort_recycled();
  if (!parts) return true;
  return parts->objects() == ids_ ? parts->join(search_.filters(), near)
                                  : find_near(*own, neighbours, have_all_changed(), near);
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

std::vector<Aabb> HostObjects::sample() {
  std::vector<Aabb> boxes;
  const std::size_t stride = ids_ / sample_size + 1;
  for (std::size_t id = 0; id < ids_; id += stride) {
    const Aabb& one = search_.boxes()[id];
    if (is_proper(one)) boxes.push_back(one);
  }
  return boxes;
}

Survey HostObjects::survey(const Grid& grid) {
  // By part, so that the ids of objects that are alone do not depend on the threads.
  constexpr std::size_t most_parts = 32;
  const std::size_t parts = std::min(most_parts, parts_of(ids_));
  std::vector<Survey> surveys(parts);
  const std::size_t threads = useful_threads(ids_, boxes_per_part, threads_);
  parallel_for(parts, threads, [&](std::size_t part, std::size_t /*thread*/) {
    const std::size_t end = ids_ * (part + 1) / parts;
    for (std::size_t id = ids_ * part / parts; id < end; ++id) {
      const Aabb& one = search_.boxes()[id];
      if (is_proper(one)) surveys[part].add(grid, static_cast<std::uint32_t>(id), one);
    }
  });
  Survey all;
  for (const Survey& survey : surveys) all.add(grid, survey);
  return all;
}

bool HostObjects::have_all_changed() const {
  return changes_.all || 4 * changes_.changed().size() > ids_;
}

bool HostObjects::find_near(const OwnBounds& own, const Neighbours& neighbours, bool all,
                            std::vector<Halo>& near) {
  const std::size_t count = all ? ids_ : changed_.size();
  NearParts parts(own, neighbours, count);
  const std::size_t threads = useful_threads(count, 2 * boxes_per_part, threads_);
  parallel_for(parts_of(count), threads, [&](std::size_t part, std::size_t /*thread*/) {
    const std::size_t begin = part * boxes_per_part;
    const std::size_t end = std::min(count, begin + boxes_per_part);
    if (all) {
      parts.find(begin, end, same, search_.boxes());
    } else {
      parts.find(
          begin, end, [this](std::size_t k) { return changed_[k]; }, search_.boxes());
    }
  });
  return parts.join(search_.filters(), near);
}

}  // namespace broadcl::mpi
