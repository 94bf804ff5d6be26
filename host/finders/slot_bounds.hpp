#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>

#include <broadcl/filter.hpp>

#include "base/two_sets.hpp"
#include "engines/algorithm.hpp"
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

/// The box of a slot and, along the fourth axis, its world or set.
template <std::size_t axes>
[[nodiscard]] Bounds<axes> bounds_of(const Input& input, std::size_t slot) noexcept {
  const Aabb& box = input.boxes[slot];
  Bounds<axes> bounds;
#pragma GCC unroll 3
  for (std::size_t axis = 0; axis < 3; ++axis) {  // std::ranges::copy() would be a call per corner
    bounds.lower[axis] = box.lower[axis];
    bounds.upper[axis] = box.upper[axis];
  }
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

}  // namespace broadcl
