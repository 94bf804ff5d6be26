#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>

#include <broadcl/export.h>

namespace broadcl {

/// An axis-aligned bounding box: two corners, float32, in the caller's unit of length.
///
/// Boxes are closed, so boxes that only touch overlap. Bounds may be infinite. A box whose lower bound
/// exceeds its upper bound on some axis is empty and overlaps nothing, not even a box that surrounds it.
///
/// The functions below test bits, not floating-point numbers, so they also hold in code that is compiled with
/// -ffast-math; == compares numbers. A program that is linked with -ffast-math, however, may make the
/// processor treat denormal numbers as 0, in this library too.
struct Aabb {
  std::array<float, 3> lower;
  std::array<float, 3> upper;

  friend bool operator==(const Aabb&, const Aabb&) = default;
};
static_assert(sizeof(Aabb) == 24, "24 bytes per box cross the bus");

namespace detail {

/// Whether two closed intervals share a point. False if a bound is NaN.
template <class T>
[[nodiscard]] constexpr bool meet(T lower_s, T upper_s, T lower_t, T upper_t) noexcept {
  return lower_s <= upper_t && lower_t <= upper_s;
}

/// One integer per bound, lower bounds first. They compare as the bounds do; those of NaNs are outside
/// -infinite_key .. infinite_key.
template <class Key, class Box>
[[nodiscard]] constexpr std::array<Key, 6> keys(const Box& box) noexcept {
  auto bits = std::bit_cast<std::array<Key, 6>>(box);
  for (Key& key : bits) {
    if (key < 0) key = std::numeric_limits<Key>::min() - key;
  }
  return bits;
}

template <class Key>
inline constexpr Key infinite_key = Key{0x7f800000};
template <>
inline constexpr std::int64_t infinite_key<std::int64_t> = 0x7ff0000000000000;

template <class Key, class Box>
[[nodiscard]] constexpr bool is_empty(const Box& box) noexcept {
  const auto key = keys<Key>(box);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const bool is_proper =
        -infinite_key<Key> <= key[axis] && key[axis] <= key[axis + 3] && key[axis + 3] <= infinite_key<Key>;
    if (!is_proper) return true;
  }
  return false;
}

template <class Key, class Box>
[[nodiscard]] constexpr bool overlaps(const Box& s, const Box& t) noexcept {
  if (is_empty<Key>(s) || is_empty<Key>(t)) return false;
  const auto key_s = keys<Key>(s);
  const auto key_t = keys<Key>(t);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (!meet(key_s[axis], key_s[axis + 3], key_t[axis], key_t[axis + 3])) return false;
  }
  return true;
}

}  // namespace detail

/// Whether some bound is NaN.
[[nodiscard]] constexpr bool has_nan(const Aabb& box) noexcept {
  for (const std::uint32_t bits : std::bit_cast<std::array<std::uint32_t, 6>>(box)) {
    if (bits << 1U > 0xff000000U) return true;  // above infinity, whatever the sign
  }
  return false;
}

/// Whether the box contains no point: inverted on some axis, or with a NaN bound.
[[nodiscard]] constexpr bool is_empty(const Aabb& box) noexcept {
  return detail::is_empty<std::int32_t>(box);
}

/// Whether two closed boxes share a point. False if one of them is empty.
[[nodiscard]] constexpr bool overlaps(const Aabb& s, const Aabb& t) noexcept {
  return detail::overlaps<std::int32_t>(s, t);
}

/// An empty box, for an object that has none: lower bounds of infinity, upper ones of -infinity.
[[nodiscard]] constexpr Aabb empty_aabb() noexcept {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  return {{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}};
}

/// A box in double precision, of which the same holds as of an Aabb: for BroadPhase64 and
/// overlapping_pairs().
struct Aabb64 {
  std::array<double, 3> lower;
  std::array<double, 3> upper;

  friend bool operator==(const Aabb64&, const Aabb64&) = default;

  // (Friends, so that a list in braces still means an Aabb.)

  /// Whether some bound is NaN.
  [[nodiscard]] friend constexpr bool has_nan(const Aabb64& box) noexcept {
    for (const std::uint64_t bits : std::bit_cast<std::array<std::uint64_t, 6>>(box)) {
      if (bits << 1U > 0xffe0000000000000U) return true;  // above infinity, whatever the sign
    }
    return false;
  }
  /// Whether the box contains no point.
  [[nodiscard]] friend constexpr bool is_empty(const Aabb64& box) noexcept {
    return detail::is_empty<std::int64_t>(box);
  }
  /// Whether two closed boxes share a point.
  [[nodiscard]] friend constexpr bool overlaps(const Aabb64& s, const Aabb64& t) noexcept {
    return detail::overlaps<std::int64_t>(s, t);
  }
};

/// An empty box in double precision.
[[nodiscard]] constexpr Aabb64 empty_aabb64() noexcept {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  return {{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}};
}

/// The smallest float32 box that contains a float64 one: lower bounds round down, upper bounds round up, so
/// pairs of the rounded boxes are a superset of the pairs of the originals. NaN stays NaN. The result does
/// not depend on the rounding mode, nor on whether the processor treats denormal numbers as 0.
[[nodiscard]] BROADCL_API Aabb round_outward(const std::array<double, 3>& lower,
                                             const std::array<double, 3>& upper) noexcept;

}  // namespace broadcl

#endif
