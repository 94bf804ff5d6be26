#pragma once

#include <cstddef>
#include <limits>

#include <broadcl/aabb.hpp>

namespace broadcl::test {

inline constexpr float infinity = std::numeric_limits<float>::infinity();
inline constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();

inline constexpr Aabb unit{{0, 0, 0}, {1, 1, 1}};
/// An empty box.
inline constexpr Aabb inverted{{1, 0, 0}, {0, 1, 1}};

/// Box k of a row in which none overlaps another.
inline Aabb apart(std::size_t k) {
  const float x = 2 * static_cast<float>(k);
  return {{x, 0, 0}, {x + 1, 1, 1}};
}

}  // namespace broadcl::test
