#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <optional>

#include "base/packed_box.hpp"

namespace broadcl {

/// A box that moves in a straight line; a ray, if it has no size.
template <class Box>
struct MovingBox {
  using Bound = BoundType<Box>;

  Box box;                             // where it starts, from the origin; packed and finite
  std::array<Bound, 3> origin{};       // finite
  std::array<Bound, 3> reciprocals{};  // of the direction; 0 along an axis that it does not move along
  Bound length{};                      // how far it moves, in multiples of the direction
};

/// Of a component of a direction. (What is nearly 0 counts as 0.)
template <class Bound>
[[nodiscard]] Bound reciprocal_of(Bound component) noexcept {
  const Bound reciprocal = 1 / component;
  return std::isinf(reciprocal) ? Bound{} : reciprocal;
}

/// When a moving box first meets a packed box, in multiples of the direction; 0 if it does where it starts.
/// The other one must not be empty. (Rounding never swaps two numbers, so it meets what contains a box no
/// later than the box.)
template <class Box>
[[nodiscard]] constexpr std::optional<BoundType<Box>> time_of_meeting(const MovingBox<Box>& moving,
                                                                      const Box& other) noexcept {
  using Bound = BoundType<Box>;
  Bound begin{};
  Bound end = moving.length;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const Bound reciprocal = moving.reciprocals[axis];
    const Bound to_lower = (other.lower[axis] - moving.box.upper[axis]) - moving.origin[axis];
    const Bound to_upper = (other.upper[axis] - moving.box.lower[axis]) - moving.origin[axis];
    if (reciprocal == 0) {
      if (to_lower > 0 || to_upper < 0) return std::nullopt;
      continue;
    }
    const Bound enters = (reciprocal > 0 ? to_lower : to_upper) * reciprocal;
    const Bound leaves = (reciprocal > 0 ? to_upper : to_lower) * reciprocal;
    if (enters > begin) begin = enters;
    if (leaves < end) end = leaves;
  }
  if (begin > end) return std::nullopt;
  return begin;
}

}  // namespace broadcl
