#pragma once

#include <array>
#include <cstdint>

#include <broadcl/filter.hpp>

namespace broadcl {

/// Finds out whether filters divide the objects into two sets, those whose group has its lowest bit set and
/// all others, such that no objects of the same set may pair. Then nothing need be tested inside a set.
class TwoSets {
 public:
  void add(const Filter& filter) noexcept {
    Set& set = sets_[filter.group & 1U];
    set.groups |= filter.group;
    set.masks |= filter.mask;
  }

  [[nodiscard]] bool are_apart() const noexcept {
    return (sets_[0].groups & sets_[0].masks) == 0 && (sets_[1].groups & sets_[1].masks) == 0;
  }

 private:
  struct Set {
    std::uint32_t groups = 0;
    std::uint32_t masks = 0;
  };
  std::array<Set, 2> sets_{};
};

}  // namespace broadcl
