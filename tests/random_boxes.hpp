#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>

#include "random_scripts.hpp"

namespace broadcl::test {

/// How a box differs from one between two corners.
enum class Shape {
  ordinary,
  thirds,         ///< In thirds instead of halves; no floating-point number is a third.
  far,            ///< Away from all ordinary ones.
  plane,          ///< As wide as Bullet's static planes on two axes.
  largest,        ///< The whole range of float.
  everywhere,     ///< Infinite on all axes.
  half_infinite,  ///< Without an upper bound on one axis.
  at_infinity,    ///< Both bounds are infinity on one axis.
  reversed,       ///< The lower bound above the upper one on one axis.
  inside_out,     ///< From the largest number to the smallest.
  nan_lower,
  nan_upper
};

/// A box with small numbers; many such boxes overlap or touch each other.
struct BoxSpec {
  std::array<int, 3> corner{};  ///< Lower corner in halves.
  std::array<int, 3> size{};    ///< In halves; with zeros it is a plane, a line or a point.
  Shape shape = Shape::ordinary;
  unsigned axis = 0;  ///< Of the shape.

  friend bool operator==(const BoxSpec&, const BoxSpec&) = default;
};

template <class Scalar>
struct BoxCorners {
  std::array<Scalar, 3> lower{}, upper{};
};

template <class Scalar>
[[nodiscard]] BoxCorners<Scalar> corners_of(const BoxSpec& spec) {
  constexpr Scalar unbounded = std::numeric_limits<Scalar>::infinity();
  constexpr Scalar nan = std::numeric_limits<Scalar>::quiet_NaN();
  constexpr auto greatest = Scalar{std::numeric_limits<float>::max()};
  const Scalar parts = spec.shape == Shape::thirds ? 3 : 2;
  BoxCorners<Scalar> box;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    box.lower[axis] = Scalar(spec.corner[axis]) / parts;
    box.upper[axis] = Scalar(spec.corner[axis] + spec.size[axis]) / parts;
  }
  Scalar& lower = box.lower.at(spec.axis);
  Scalar& upper = box.upper.at(spec.axis);
  const auto all = [&](Scalar bound) {
    box.lower.fill(-bound);
    box.upper.fill(bound);
  };
  switch (spec.shape) {
    case Shape::ordinary:
    case Shape::thirds:
      break;
    case Shape::far:
      lower += 1000;
      upper += 1000;
      break;
    case Shape::plane: {
      const Scalar from = lower;
      const Scalar to = upper;
      all(Scalar(1e18));
      lower = from;
      upper = to;
      break;
    }
    case Shape::largest:
      all(greatest);
      break;
    case Shape::everywhere:
      all(unbounded);
      break;
    case Shape::half_infinite:
      upper = unbounded;
      break;
    case Shape::at_infinity:
      lower = upper = unbounded;
      break;
    case Shape::reversed:
      lower = upper + 1;
      break;
    case Shape::inside_out:
      all(-greatest);
      break;
    case Shape::nan_lower:
      lower = nan;
      break;
    case Shape::nan_upper:
      upper = nan;
      break;
  }
  return box;
}

/// Box k of an operation that takes several: the first, moved.
/// @param extent Of the corners, in halves.
[[nodiscard]] inline BoxSpec box_of_call(const BoxSpec& first, unsigned k, int extent = 24) {
  BoxSpec box = first;
  if (k == 0) return box;
  const auto step = static_cast<int>(k);
  box.corner = {(box.corner[0] + 7 * step) % extent, (box.corner[1] + 3 * step) % extent,
                (box.corner[2] + 5 * step + step / extent) % extent};
  return box;
}

/// @param extent Of the corners, in halves.
/// @param odd How many in a hundred have another shape than the ordinary one.
[[nodiscard]] inline BoxSpec random_box(Dice& dice, unsigned extent, unsigned odd) {
  BoxSpec spec;
  for (int& x : spec.corner) x = static_cast<int>(dice.below(extent));
  for (int& x : spec.size) x = static_cast<int>(dice.below(5));
  if (dice.one_in(30)) spec.size = {40, 40, 40};
  if (dice.below(100) < odd) {
    spec.shape = static_cast<Shape>(1 + dice.below(static_cast<unsigned>(Shape::nan_upper)));
  }
  spec.axis = dice.below(3);
  return spec;
}

}  // namespace broadcl::test
