#pragma once

#include <algorithm>
#include <cstddef>

#include "base/packed_box.hpp"

namespace broadcl {

/// Gaps and reaches below this count as 0, so that no square is denormal.
template <class Bound>
inline constexpr Bound least_distance = static_cast<Bound>(0x1p-63);

/// No reach may be greater, so that the square of the sum of two is finite.
template <class Bound>
inline constexpr Bound most_reach = static_cast<Bound>(0x1p62);

/// The gap between two intervals along an axis; 0 if they overlap. (Infinities are compared, and never
/// subtracted from each other.)
template <class Bound>
[[nodiscard]] constexpr Bound gap_between(Bound lower_s, Bound upper_s, Bound lower_t,
                                          Bound upper_t) noexcept {
  const Bound gap = upper_s < lower_t ? lower_t - upper_s : upper_t < lower_s ? lower_s - upper_t : Bound{};
  return gap < least_distance<Bound> ? Bound{} : gap;
}

/// The square of the distance of two packed boxes, neither of them empty. Rounded after each operation to the
/// nearest number, and added in this order, so that all devices agree.
template <class Box>
[[nodiscard]] constexpr BoundType<Box> squared_distance(const Box& s, const Box& t) noexcept {
  const auto gap = [&](std::size_t axis) {
    return gap_between(s.lower[axis], s.upper[axis], t.lower[axis], t.upper[axis]);
  };
  return (gap(0) * gap(0) + gap(1) * gap(1)) + gap(2) * gap(2);
}

/// Whether two packed boxes are at most so far apart. (With an empty one, false.)
template <class Box>
[[nodiscard]] constexpr bool is_within(const Box& s, const Box& t, BoundType<Box> distance) noexcept {
  if (distance < least_distance<BoundType<Box>>) return packed_overlaps(s, t);
  return is_proper(s) && is_proper(t) && squared_distance(s, t) <= distance * distance;
}

/// How far images may be, at most, from where the map of coordinates has them before it rounds, on all axes
/// together, with all gaps that count as 0.
/// @param largest No bound of the images is farther from 0.
[[nodiscard]] constexpr float image_error(float largest) noexcept {
  return largest * 0x1p-23F + 2 * least_distance<float>;
}

/// Whether boxes in double precision may be within the sum of their reaches or not, although their images
/// are, by a map that keeps distances.
/// @param distance The sum of the reaches of the images: they are longer by their errors.
[[nodiscard]] constexpr bool is_in_doubt(const Aabb& s, const Aabb& t, float distance) noexcept {
  if (packed_touch(s, t, 7)) return true;
  float largest = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    largest = std::max({largest, s.upper[axis], t.upper[axis], -s.lower[axis], -t.lower[axis]});
  }
  const float sure = (distance - 4 * image_error(largest)) * (1 - 0x1p-18F);
  return !(sure > 0 && squared_distance(s, t) <= sure * sure) && !packed_overlaps(s, t);
}

/// A packed box enlarged by a reach: if boxes are within the sum of their reaches, such boxes overlap, in
/// spite of all rounding. An empty one stays empty.
// (is_within() rounds five times, so gaps are less than 1 + 2^-21 times the sum, and margins of two boxes
// more than a gap. Hence bounds would overlap if they were not rounded, and rounding never swaps numbers.)
template <class Box>
[[nodiscard]] constexpr Box grown(Box box, BoundType<Box> reach) noexcept {
  const BoundType<Box> margin = reach * static_cast<BoundType<Box>>(1 + 0x1p-20);
#pragma GCC unroll 3
  for (std::size_t axis = 0; axis < 3; ++axis) {
    box.lower[axis] -= margin;
    box.upper[axis] += margin;
  }
  return box;
}

}  // namespace broadcl
