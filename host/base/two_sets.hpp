#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include <broadcl/filter.hpp>

#include "base/filter_bits.hpp"

namespace broadcl {

/// Finds out whether filters divide the objects into two sets, those whose group has its lowest bit set and
/// all others, such that no objects of the same set may pair. Then nothing need be tested inside a set.
class TwoSets {
 public:
  /// The set of an object with this filter: 0 or 1.
  [[nodiscard]] static std::uint32_t set_of(const Filter& filter) noexcept { return filter.group & 1U; }

  void add(const Filter& filter) noexcept { sets_[set_of(filter)].add(filter); }
  /// @param filter Was added, and not removed since then.
  void remove(const Filter& filter) noexcept { sets_[set_of(filter)].remove(filter); }

  [[nodiscard]] bool are_apart() const noexcept {
    return std::ranges::all_of(sets_, [](const FilterBits& set) {
      const Filter any = set.any();
      return (any.group & any.mask) == 0;
    });
  }

  /// If the sets are apart, whether every two objects of different sets may pair. Then the filters of a pair
  /// need not be tested.
  [[nodiscard]] bool decide() const noexcept {
    return std::ranges::all_of(sets_, are_alike) && may_pair(sets_[0].any(), sets_[1].any());
  }

 private:
  /// Whether all filters of a set are the same, for a single world.
  static bool are_alike(const FilterBits& set) noexcept {
    const Filter any = set.any();
    return !set.empty() && any == set.all() && any.world != Filter::all_worlds;
  }

  std::array<FilterBits, 2> sets_;
};

}  // namespace broadcl
