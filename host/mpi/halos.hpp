#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/mpi.hpp>

#include "base/parallel.hpp"
#include "base/threads.hpp"
#include "mpi/ranks.hpp"

namespace broadcl::mpi {

/// The objects of a halo, by id.
struct Halo {
  std::vector<std::uint32_t> ids;
  std::vector<Aabb> boxes;
  std::vector<Filter> filters;

  void clear() noexcept;
  void add(std::uint32_t id, const Aabb& box, const Filter& filter);
  void resize(std::size_t count);
  void set(std::size_t position, std::uint32_t id, const Aabb& box, const Filter& filter) noexcept {
    ids[position] = id;
    boxes[position] = box;
    filters[position] = filter;
  }
};

/// What changed in a halo since the last update. Positions are indices in the halo, ascending.
struct HaloChanges {
  std::span<const MpiPair> exclusions{};  ///< Those with the receiver, in canonical order.
  bool has_exclusions = false;            ///< If not, they are as before.
  std::span<const std::uint32_t> left{};  ///< Positions in the last halo.
  std::span<const std::uint32_t> entered{};
  std::span<const Aabb> entered_boxes{};
  std::span<const Filter> entered_filters{};
  std::span<const std::uint32_t> moved{};  ///< Positions in the new halo.
  std::span<const Aabb> moved_boxes{};
  std::span<const std::uint32_t> refiltered{};  ///< Likewise.
  std::span<const Filter> new_filters{};

  /// Writes changes of consecutive parts of a halo, of which at most one has exclusions.
  static void write(std::span<const HaloChanges> parts, Bytes& message);
  /// @param message Must outlive this object. An empty one has no changes.
  [[nodiscard]] static HaloChanges read(const Bytes& message);
};

/// A halo in the last update and in this one.
class HaloHistory {
 public:
  /// Makes the new halo.
  /// @param near The objects of this halo among those that changed. Its content is unspecified afterwards.
  /// @param changed Ids, ascending, if not `all`: other objects are in the halo if they were.
  void renew(Halo& near, bool all, std::span<const std::uint32_t> changed);
  /// Describes what changed.
  /// @param recycled Ids that belong to other objects now, ascending.
  void write(std::span<const std::uint32_t> recycled, const HaloChanges& exclusions, const Threads& threads,
             Bytes& message);
  /// Describes the halo of the last update as if it had been empty before.
  void write_last(Bytes& message) const;
  void commit() noexcept;

 private:
  /// Memory for what changed among consecutive objects.
  struct alignas(cache_line) Part {
    std::vector<std::uint32_t> left, moved, refiltered;
    std::vector<Aabb> moved_boxes;
    std::vector<Filter> new_filters;
    Halo entered;

    void clear() noexcept;
    [[nodiscard]] HaloChanges changes() const;
  };

  void compare(std::size_t part, std::span<const std::uint32_t> recycled);

  Halo last_, next_;
  bool is_new_ = false;  // otherwise next_ is unused, and the halo is as before
  std::vector<Part> parts_;
};

}  // namespace broadcl::mpi
