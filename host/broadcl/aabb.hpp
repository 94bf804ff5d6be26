#pragma once

#include <array>
#include <cstddef>
#include <limits>

namespace broadcl {

/// An axis-aligned bounding box: two corners, float32, in the caller's unit of length.
///
/// Boxes are closed, so boxes that only touch overlap. Bounds may be infinite. A box whose lower bound
/// exceeds its upper bound on some axis is empty and overlaps nothing, not even a box that surrounds it.
struct Aabb {
  std::array<float, 3> lower;
  std::array<float, 3> upper;

  friend bool operator==(const Aabb&, const Aabb&) = default;
};
static_assert(sizeof(Aabb) == 24, "24 bytes a box cross the bus");

/// Whether two closed boxes share a point. False as soon as a bound is NaN.
[[nodiscard]] constexpr bool overlaps(const Aabb& s, const Aabb& t) noexcept {
  return s.lower[0] <= t.upper[0] && t.lower[0] <= s.upper[0] && s.lower[1] <= t.upper[1] &&
         t.lower[1] <= s.upper[1] && s.lower[2] <= t.upper[2] && t.lower[2] <= s.upper[2];
}

/// Whether the box contains no point: inverted on some axis, or with a NaN bound.
[[nodiscard]] constexpr bool is_empty(const Aabb& box) noexcept {
  return !overlaps(box, box);
}

/// Whether some bound is NaN.
[[nodiscard]] constexpr bool has_nan(const Aabb& box) noexcept {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (box.lower[axis] != box.lower[axis] || box.upper[axis] != box.upper[axis]) return true;
  }
  return false;
}

/// The canonical empty box: six NaNs, for which every closed comparison is false.
[[nodiscard]] constexpr Aabb empty_aabb() noexcept {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  return {{nan, nan, nan}, {nan, nan, nan}};
}

/// The smallest float32 box that contains a float64 one: lower bounds round down, upper bounds round up, so
/// pairs of the rounded boxes are a superset of the pairs of the originals. NaN stays NaN.
[[nodiscard]] Aabb round_outward(const std::array<double, 3>& lower,
                                 const std::array<double, 3>& upper) noexcept;

}  // namespace broadcl
