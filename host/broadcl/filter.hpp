#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <cstdint>

namespace broadcl {

/// Decides, besides the boxes, whether two objects pair: see may_pair().
struct Filter {
  /// Value of `body`: the object belongs to no body.
  static constexpr std::uint32_t no_body = 0xffffffff;

  /// Value of `world`: the object is in all worlds.
  static constexpr std::uint32_t all_worlds = 0xffffffff;

  /// Filters for two sets: only pairs of one object of each set are found, and nothing is tested inside a
  /// set. The first set is the group of bit 0, of value 1, and pairs with that of bit 1, of value 2, only.
  ///
  /// (Other filters have the same effect if the lowest bit of `group` divides all objects into two sets that
  /// pair only with each other.)
  static const Filter first_set;

  /// The second set is the group of bit 1, of value 2, and pairs with that of bit 0 only: see first_set.
  static const Filter second_set;

  std::uint32_t group = 1;          ///< One bit per group that the object is in.
  std::uint32_t mask = 0xffffffff;  ///< One bit per group that the object pairs with.
  std::uint32_t body = no_body;     ///< Objects of the same body never pair.
  std::uint32_t world = 0;          ///< Objects of different worlds never pair.

  friend constexpr bool operator==(const Filter&, const Filter&) = default;
};
static_assert(sizeof(Filter) == 16, "kernels read it as a uint4");

inline constexpr Filter Filter::first_set{.group = 1, .mask = 2};
inline constexpr Filter Filter::second_set{.group = 2, .mask = 1};

/// Whether the filters of two objects let them pair: each is in a group of the other's mask, they are in the
/// same world or one of them is in all worlds, and they are not of the same body.
[[nodiscard]] constexpr bool may_pair(const Filter& s, const Filter& t) noexcept {
  const bool worlds_meet =
      s.world == t.world || s.world == Filter::all_worlds || t.world == Filter::all_worlds;
  return (s.group & t.mask) != 0 && (t.group & s.mask) != 0 && worlds_meet &&
         (s.body != t.body || s.body == Filter::no_body);
}

}  // namespace broadcl

#endif
