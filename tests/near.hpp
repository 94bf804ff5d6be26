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
  volatile double result = operation(static_cast<double>(s), static_cast<double>(t));
  return static_cast<Bound>(result);
}

/// By the definition of BasicBroadPhase::set_reach().
template <class Box>
[[nodiscard]] bool are_near(const Box& s, const Box& t, BoundOf<Box> reach_s, BoundOf<Box> reach_t) {
  using Bound = BoundOf<Box>;
  if (reach_s == 0 && reach_t == 0) return overlaps(s, t);
  const auto least = static_cast<Bound>(std::ldexp(1, -63));
  const ScopedRounding rounding(FE_TONEAREST);
  if (is_empty(s) || is_empty(t)) return false;
  const Bound sum = rounded(reach_s, reach_t, std::plus());
  if (sum < least) return overlaps(s, t);
  std::array<Bound, 3> squares{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    Bound gap = 0;
    if (s.upper[axis] < t.lower[axis]) gap = rounded(t.lower[axis], s.upper[axis], std::minus());
    if (t.upper[axis] < s.lower[axis]) gap = rounded(s.lower[axis], t.upper[axis], std::minus());
    if (gap < least) gap = 0;
    squares.at(axis) = rounded(gap, gap, std::multiplies());
  }
  const Bound distance = rounded(rounded(squares[0], squares[1], std::plus()), squares[2], std::plus());
  return distance <= rounded(sum, sum, std::multiplies());
}

}  // namespace broadcl::test
