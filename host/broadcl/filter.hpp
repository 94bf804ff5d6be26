#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <broadcl/export.h>

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

/// Filters of layers, by a function that says which of them pair, for instance by a matrix. An object gets
/// that of its layer; body and world may be set in it.
///
/// Up to 32 layers are the groups: layer k has the bit k. Of more layers, those that pair with the same
/// layers share a group.
/// @param pairs Whether two layers pair, by their indices; the same for (a, b) as for (b, a).
/// @throws Error if it differs for (a, b) and (b, a), and if more than 32 groups would be needed.
[[nodiscard]] BROADCL_API std::vector<Filter> filters_from_layers(
    std::size_t layers, const std::function<bool(std::size_t, std::size_t)>& pairs);

/// Filters of objects of which two pair if either has a type of the other's affinity, where Filter asks for
/// both. These are MuJoCo's contype and conaffinity.
/// @param types One bit per type of each object.
/// @param affinities One bit per type with which each object pairs.
/// @returns One filter per object, of as many groups as there are combinations; if these are more than 32,
/// those that pair with the same ones share a group.
/// @throws Error if there are not as many types as affinities, and if more than 32 groups would be needed.
[[nodiscard]] BROADCL_API std::vector<Filter> filters_from_one_sided(
    std::span<const std::uint32_t> types, std::span<const std::uint32_t> affinities);

}  // namespace broadcl

#endif
