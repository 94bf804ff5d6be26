#pragma once

#include <array>
#include <cstddef>

namespace broadcl {

/// A box in double precision, as Aabb is one in single precision.
struct Aabb64 {
  std::array<double, 3> lower;
  std::array<double, 3> upper;

  [[nodiscard]] constexpr bool has_nan() const noexcept {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      // NOLINTNEXTLINE(misc-redundant-expression): only a NaN differs from itself
      if (lower[axis] != lower[axis] || upper[axis] != upper[axis]) return true;
    }
    return false;
  }

  /// Whether there are points in it.
  [[nodiscard]] constexpr bool is_proper() const noexcept {
    return lower[0] <= upper[0] && lower[1] <= upper[1] && lower[2] <= upper[2];
  }

  /// Whether both are proper, and overlap or touch.
  [[nodiscard]] constexpr bool overlaps(const Aabb64& other) const noexcept {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!(lower[axis] <= other.upper[axis] && other.lower[axis] <= upper[axis])) return false;
    }
    return is_proper() && other.is_proper();
  }
};

template <class S>
[[nodiscard]] constexpr Aabb64 to_aabb64(const std::array<S, 3>& lower,
                                         const std::array<S, 3>& upper) noexcept {
  Aabb64 box{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    box.lower[axis] = static_cast<double>(lower[axis]);
    box.upper[axis] = static_cast<double>(upper[axis]);
  }
  return box;
}

}  // namespace broadcl
