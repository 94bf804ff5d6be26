#pragma once

#include <cstdint>

namespace broadcl {

/// Decides, besides the boxes, whether two objects pair: see may_pair().
struct Filter {
  /// Value of `body`: the object is a body of its own.
  static constexpr std::uint32_t no_body = 0xffffffff;

  /// Value of `world`: the object is in all worlds.
  static constexpr std::uint32_t all_worlds = 0xffffffff;

  std::uint32_t group = 1;          ///< One bit per group that the object is in.
  std::uint32_t mask = 0xffffffff;  ///< One bit per group that the object pairs with.
  std::uint32_t body = no_body;     ///< Objects of the same body never pair.
  std::uint32_t world = 0;          ///< Objects of different worlds never pair.

  friend constexpr bool operator==(const Filter&, const Filter&) = default;
};
static_assert(sizeof(Filter) == 16, "kernels read it as a uint4");

/// Filters of two sets, of which only one object of each may pair: nothing is tested inside a set. (That is
/// so whenever the lowest bit of `group` parts all objects into two such sets.)
inline constexpr Filter first_set{.group = 1, .mask = 2};
inline constexpr Filter second_set{.group = 2, .mask = 1};

/// Whether the filters of two objects let them pair: each is in a group of the other's mask, and they are in
/// the same world, or one of them in all worlds, and not of the same body.
[[nodiscard]] constexpr bool may_pair(const Filter& s, const Filter& t) noexcept {
  const bool worlds_meet =
      s.world == t.world || s.world == Filter::all_worlds || t.world == Filter::all_worlds;
  return (s.group & t.mask) != 0 && (t.group & s.mask) != 0 && worlds_meet &&
         (s.body != t.body || s.body == Filter::no_body);
}

}  // namespace broadcl
