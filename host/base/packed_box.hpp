#pragma once

#include <cstddef>
#include <cstring>
#include <exception>
#include <limits>
#include <string>

#include <broadcl/aabb.hpp>
#include <broadcl/error.hpp>

namespace broadcl {

/// The type of a box's bounds.
template <class Box>
using BoundType = typename decltype(Box::lower)::value_type;

/// Bit k is set if axis k is in the set.
using AxisSet = unsigned;

/// Algorithms and kernels read packed boxes: a packed box is either not empty, or packed_empty(), for which
/// every closed comparison is false.
template <class Box = Aabb>
[[nodiscard]] constexpr Box packed_empty() noexcept {
  constexpr auto nan = std::numeric_limits<BoundType<Box>>::quiet_NaN();
  return {{nan, nan, nan}, {nan, nan, nan}};
}

/// overlaps() of packed boxes, or of what has more axes.
template <std::size_t axes = 3, class Box>
[[nodiscard]] constexpr bool packed_overlaps(const Box& s, const Box& t) noexcept {
  bool all = true;
  for (std::size_t k = 0; k < axes; ++k) {
    all &= detail::meet(s.lower[k], s.upper[k], t.lower[k], t.upper[k]);
  }
  return all;
}

/// Whether two packed boxes that overlap have a bound in common on one of some axes: the lower one of one and
/// the upper one of the other.
[[nodiscard]] constexpr bool packed_touch(const Aabb& s, const Aabb& t, AxisSet axes) noexcept {
  AxisSet touch = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const bool is_common = s.lower[axis] == t.upper[axis] || t.lower[axis] == s.upper[axis];
    touch |= static_cast<AxisSet>(is_common) << axis;
  }
  return (touch & axes) != 0;
}

/// Whether a box is neither empty nor has a NaN.
[[nodiscard]] constexpr bool is_proper(const Aabb& box) noexcept {
  return packed_overlaps(box, box);
}
[[nodiscard]] constexpr bool is_proper(const Aabb64& box) noexcept {
  return !is_empty(box);  // also if the processor takes denormal numbers for zeros
}

template <class Box>
[[nodiscard]] constexpr Box pack(const Box& box) noexcept {
  return is_proper(box) ? box : packed_empty<Box>();
}

template <class Box>
[[nodiscard]] bool same_bits(const Box& s, const Box& t) noexcept {
  // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison): NaNs equal each other, and -0 differs from 0
  return std::memcmp(&s, &t, sizeof(Box)) == 0;
}

/// A box has a NaN bound. (No Error, which an algorithm might take for one of its own.)
struct InvalidBox : std::exception {
  explicit InvalidBox(std::size_t which) : index(which) {}
  std::size_t index;
};

[[noreturn]] inline void throw_nan(const std::string& what) {
  throw Error::invalid_argument(
      what + " has a NaN bound; give an empty box (lower > upper) for an object without one");
}

}  // namespace broadcl
