#pragma once

#include <limits>

#include <broadcl/aabb.hpp>

namespace broadcl {

/// A packed box is what algorithms and kernels read: a box that is not empty, or packed_empty(), for which
/// every closed comparison is false.
[[nodiscard]] constexpr Aabb packed_empty() noexcept {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  return {{nan, nan, nan}, {nan, nan, nan}};
}

/// overlaps() of packed boxes.
[[nodiscard]] constexpr bool packed_overlaps(const Aabb& s, const Aabb& t) noexcept {
  return s.lower[0] <= t.upper[0] && t.lower[0] <= s.upper[0] && s.lower[1] <= t.upper[1] &&
         t.lower[1] <= s.upper[1] && s.lower[2] <= t.upper[2] && t.lower[2] <= s.upper[2];
}

[[nodiscard]] constexpr Aabb pack(const Aabb& box) noexcept {
  return packed_overlaps(box, box) ? box : packed_empty();
}

}  // namespace broadcl
