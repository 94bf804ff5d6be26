#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>

#include "base/box_parts.hpp"
#include "base/threads.hpp"
#include "mpi/bounds.hpp"
#include "mpi/halos.hpp"

namespace broadcl::mpi {

struct Placed {
  std::uint32_t id;
  Aabb box;
};
[[nodiscard]] inline Placed placed(std::size_t id, std::span<const Aabb> boxes) noexcept {
  return {.id = static_cast<std::uint32_t>(id), .box = boxes[id]};
}

struct Labelled {
  std::uint32_t id;
  Filter filter;
};
/// @param filters By id; none if all are the default one.
[[nodiscard]] inline Labelled labelled(std::size_t id, std::span<const Filter> filters) noexcept {
  return {.id = static_cast<std::uint32_t>(id), .filter = filters.empty() ? Filter() : filters[id]};
}

/// Which of some objects belong to which halo, found part by part: see for_each_part().
class NearParts {
 public:
  /// @param own, neighbours Must outlive this object.
  /// @param objects How many there are.
  /// @param threads At most; 0 for one per processor.
  NearParts(const OwnBounds& own, const Neighbours& neighbours, std::size_t objects, Threads threads)
      : own_(own),
        neighbours_(neighbours),
        parts_(parts_of(objects)),
        objects_(objects),
        threads_(std::move(threads)) {}

  /// Looks at the objects from `begin` to `end`, one part. May be called for several at the same time.
  /// @param at Returns the id and the box of object k: Placed.
  template <class At>
  void find(std::size_t begin, std::size_t end, const At& at) {
    std::vector<Near> found;
    bool are_inside = true;
    for (std::size_t k = begin; k < end; ++k) {
      const Placed placed = at(k);
      are_inside &= neighbours_.for_each_halo(own_, placed.id, placed.box, [&](std::uint32_t halo) {
        found.push_back({.halo = halo, .object = static_cast<std::uint32_t>(k), .box = placed.box});
      });
    }
    if (!are_inside) are_inside_ = false;
    parts_[begin / boxes_per_part] = std::move(found);
    seen_ += end - begin;
  }
  /// Looks at all objects.
  template <class At>
  void find_all(const At& at) {
    const Threads useful = useful_threads(objects_, 2 * boxes_per_part, threads_);
    parallel_for(parts_.size(), useful, [&](std::size_t part, std::size_t /*thread*/) {
      const std::size_t begin = part * boxes_per_part;
      find(begin, std::min(objects_, begin + boxes_per_part), at);
    });
  }
  [[nodiscard]] bool has_seen_all() const noexcept { return seen_ == objects_; }

  /// @param label Returns the id and the filter of object k: Labelled. Ids must ascend.
  /// @param near What it found, by halo.
  /// @returns Whether the bounds contain all objects. If not, `near` may be incomplete.
  template <class Label>
  bool join(const Label& label, std::vector<Halo>& near) const {
    std::size_t found = 0;
    for (const std::vector<Near>& part : parts_) found += part.size();
    const Threads useful = useful_threads(found, 2 * boxes_per_part, threads_);
    const std::size_t groups = useful.most;
    // By halo: how many objects a group of parts has, and then where its next one is to be written.
    using Places = std::vector<std::size_t>;
    std::vector<Places> places(groups, Places(near.size()));
    const auto for_each_near = [&](const auto& function) {
      parallel_for(groups, useful, [&](std::size_t group, std::size_t /*thread*/) {
        Places own = places[group];  // so that threads do not write side by side
        const std::size_t end = parts_.size() * (group + 1) / groups;
        for (std::size_t k = parts_.size() * group / groups; k < end; ++k) {
          for (const Near& object : parts_[k]) function(object, own[object.halo]);
        }
        places[group] = std::move(own);
      });
    };
    for_each_near([](const Near& /*object*/, std::size_t& count) { ++count; });
    for (std::size_t halo = 0; halo < near.size(); ++halo) {
      std::size_t size = 0;
      for (Places& of_group : places) size += std::exchange(of_group[halo], size);
      near[halo].resize(size);
    }
    for_each_near([&](const Near& object, std::size_t& place) {
      const Labelled labelled = label(object.object);
      near[object.halo].set(place++, labelled.id, object.box, labelled.filter);
    });
    return are_inside_;
  }

 private:
  struct Near {
    std::uint32_t halo, object;
    Aabb box;
  };

  const OwnBounds& own_;
  const Neighbours& neighbours_;
  std::vector<std::vector<Near>> parts_;
  std::size_t objects_;
  Threads threads_;
  std::atomic<bool> are_inside_ = true;
  std::atomic<std::size_t> seen_ = 0;
};

/// Finds the objects that belong to halos among all objects of a rank.
/// @param boxes, filters By id; no filters if all are the default one.
/// @returns As NearParts::join().
[[nodiscard]] inline bool find_near(const OwnBounds& own, const Neighbours& neighbours,
                                    std::span<const Aabb> boxes, std::span<const Filter> filters,
                                    const Threads& threads, std::vector<Halo>& near) {
  NearParts parts(own, neighbours, boxes.size(), threads);
  parts.find_all([&](std::size_t id) { return placed(id, boxes); });
  return parts.join([&](std::size_t id) { return labelled(id, filters); }, near);
}

}  // namespace broadcl::mpi
