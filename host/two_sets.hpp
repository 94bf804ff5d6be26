#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include <broadcl/filter.hpp>

namespace broadcl {

/// Finds out whether filters divide the objects into two sets, those whose group has its lowest bit set and
/// all others, such that no objects of the same set may pair. Then nothing need be tested inside a set.
class TwoSets {
 public:
  /// The set of an object with this filter: 0 or 1.
  [[nodiscard]] static std::uint32_t set_of(const Filter& filter) noexcept { return filter.group & 1U; }

  void add(const Filter& filter) noexcept {
    Set& set = sets_[set_of(filter)];
    if (!set.first) set.first = filter;
    set.groups |= filter.group;
    set.masks |= filter.mask;
    all_alike_ = all_alike_ && filter == *set.first && filter.world != Filter::all_worlds;
  }

  [[nodiscard]] bool are_apart() const noexcept {
    return (sets_[0].groups & sets_[0].masks) == 0 && (sets_[1].groups & sets_[1].masks) == 0;
  }

  /// If the sets are apart, whether every two objects of different sets may pair. Then the filters of a pair
  /// need not be tested.
  [[nodiscard]] bool decide() const noexcept {
    return all_alike_ && sets_[0].first && sets_[1].first && may_pair(*sets_[0].first, *sets_[1].first);
  }

 private:
  struct Set {
    std::optional<Filter> first;
    std::uint32_t groups = 0;
    std::uint32_t masks = 0;
  };
  std::array<Set, 2> sets_{};
  bool all_alike_ = true;  // in each set, and none in all worlds
};

}  // namespace broadcl
