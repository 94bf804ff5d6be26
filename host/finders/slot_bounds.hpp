#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>

#include <broadcl/filter.hpp>

#include "base/distance.hpp"
#include "base/two_sets.hpp"
#include "engines/algorithm.hpp"
#include "engines/box_tree.hpp"
#include "finders/tile_search.hpp"

namespace broadcl {

/// The number without those of its last bits that a float cannot represent, so that no rounding mode matters.
[[nodiscard]] inline float exact(std::uint32_t number) noexcept {
  constexpr int digits = std::numeric_limits<float>::digits;
  const int lost =
      std::max(std::numeric_limits<std::uint32_t>::digits - std::countl_zero(number), digits) - digits;
  return static_cast<float>(number >> lost << lost);
}

/// Where the set of an object is along the fourth axis: a number that a float can represent.
[[nodiscard]] inline std::uint32_t place_of_set(const Filter& filter) noexcept {
  constexpr std::uint32_t most = (1U << 23U) - 1;
  return 2 * std::min(filter.world, most) + TwoSets::set_of(filter);
}

/// A box without a place along the fourth axis.
template <std::size_t axes>
[[nodiscard]] Bounds<axes> bounds_of(const Aabb& box) noexcept {
  Bounds<axes> bounds;
#pragma GCC unroll 3
  for (std::size_t axis = 0; axis < 3; ++axis) {  // std::ranges::copy() would be a call per corner
    bounds.lower[axis] = box.lower[axis];
    bounds.upper[axis] = box.upper[axis];
  }
  return bounds;
}

/// The box of a slot and, along the fourth axis, its world or set.
template <std::size_t axes>
[[nodiscard]] Bounds<axes> bounds_of(const Input& input, std::size_t slot) noexcept {
  Bounds<axes> bounds = bounds_of<axes>(input.boxes[slot]);
  if (!input.rules.reaches.empty()) bounds = grown(bounds, input.rules.reaches[slot]);
  if constexpr (axes > 3) {
    // Several worlds may have the same coordinate; may_pair() distinguishes them.
    const Filter& filter = input.rules.filters[slot];
    const bool is_in_all = filter.world == Filter::all_worlds;
    const float place = exact(input.rules.sets ? place_of_set(filter) : filter.world);
    bounds.lower[3] = is_in_all ? 0 : place;
    bounds.upper[3] = is_in_all ? std::numeric_limits<float>::infinity() : place;
  }
  return bounds;
}

/// A box to search for, grown by its reach, and, along the fourth axis, where the objects of a world are.
template <std::size_t axes>
[[nodiscard]] Bounds<axes> bounds_of(const QueryBox& query, bool sets) noexcept {
  Bounds<axes> bounds = bounds_of<axes>(query.reach > 0 ? grown(query.box, query.reach) : query.box);
  if constexpr (axes > 3) {
    const bool is_in_all = query.world == Filter::all_worlds;
    const float first = exact(sets ? place_of_set({.group = 0, .world = query.world}) : query.world);
    bounds.lower[3] = is_in_all ? 0 : first;
    bounds.upper[3] = is_in_all ? std::numeric_limits<float>::infinity() : sets ? first + 1 : first;
  }
  return bounds;
}

}  // namespace broadcl
