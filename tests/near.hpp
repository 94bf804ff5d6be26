#pragma once

#include <array>
#include <cfenv>
#include <cmath>
#include <cstddef>
#include <functional>

#include <broadcl/aabb.hpp>

#include "rounding.hpp"

namespace broadcl::test {

template <class Box>
using BoundOf = typename decltype(Box::lower)::value_type;

/// One operation in the precision of the bounds: double is wide enough for float to be rounded only once.
template <class Bound, class Operation>
[[nodiscard]] Bound rounded(Bound s, Bound t, const Operation& operation) {
  volatile double exact = operation(static_cast<double>(s), static_cast<double>(t));
  volatile auto result = static_cast<Bound>(exact);  // in the present rounding mode
  return result;
}

/// By the definition of BasicBroadPhase::set_reach(), of boxes that are not empty.
template <class Box>
[[nodiscard]] BoundOf<Box> squared_distance_of(const Box& s, const Box& t) {
  using Bound = BoundOf<Box>;
  const ScopedRounding rounding(FE_TONEAREST);
  const auto least = static_cast<Bound>(std::ldexp(1, -63));
  std::array<Bound, 3> squares{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    Bound gap = 0;
    if (s.upper[axis] < t.lower[axis]) gap = rounded(t.lower[axis], s.upper[axis], std::minus());
    if (t.upper[axis] < s.lower[axis]) gap = rounded(s.lower[axis], t.upper[axis], std::minus());
    if (gap < least) gap = 0;
    squares.at(axis) = rounded(gap, gap, std::multiplies());
  }
  return rounded(rounded(squares[0], squares[1], std::plus()), squares[2], std::plus());
}

/// The same for whether they are near.
template <class Box>
[[nodiscard]] bool are_near(const Box& s, const Box& t, BoundOf<Box> reach_s, BoundOf<Box> reach_t) {
  using Bound = BoundOf<Box>;
  if (reach_s == 0 && reach_t == 0) return overlaps(s, t);
  const auto least = static_cast<Bound>(std::ldexp(1, -63));
  const ScopedRounding rounding(FE_TONEAREST);
  if (is_empty(s) || is_empty(t)) return false;
  const Bound sum = rounded(reach_s, reach_t, std::plus());
  if (sum < least) return overlaps(s, t);
  return squared_distance_of(s, t) <= rounded(sum, sum, std::multiplies());
}

}  // namespace broadcl::test
