#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include <broadcl/aabb.hpp>

#include "each_algorithm.hpp"

/// Boxes that double precision can tell apart, and single precision cannot.
namespace broadcl::test {

using Boxes64 = std::vector<Aabb64>;

inline constexpr double infinity64 = std::numeric_limits<double>::infinity();

/// By the definition, of boxes that overlap on the first axis.
[[nodiscard]] inline Pairs expected_pairs(const Boxes64& boxes) {
  std::vector<std::uint32_t> ids(boxes.size());
  std::iota(ids.begin(), ids.end(), 0U);
  const auto lower = [&](std::uint32_t id) { return boxes[id].lower[0]; };
  std::ranges::sort(ids, std::ranges::less(), lower);
  Pairs pairs;
  for (auto one = ids.begin(); one != ids.end(); ++one) {
    for (auto other = one + 1; other != ids.end() && lower(*other) <= boxes[*one].upper[0]; ++other) {
      if (overlaps(boxes[*one], boxes[*other]))
        pairs.push_back({std::min(*one, *other), std::max(*one, *other)});
    }
  }
  std::ranges::sort(pairs);
  return pairs;
}

/// Of a box of one set and one of another.
[[nodiscard]] inline Pairs expected_pairs(const Boxes64& first, const Boxes64& second) {
  Pairs pairs;
  for (std::uint32_t b = 0; b < second.size(); ++b) {
    for (std::uint32_t a = 0; a < first.size(); ++a) {
      if (overlaps(first[a], second[b])) pairs.push_back({a, b});
    }
  }
  return pairs;
}

/// Cubes side by side, whose faces meet or miss each other by an ulp: 0.1 + 0.2 and 0.3.
[[nodiscard]] inline Boxes64 flush_cubes(int edge, double offset) {
  Boxes64 boxes;
  for (int x = 0; x < edge; ++x) {
    for (int y = 0; y < edge; ++y) {
      for (int z = 0; z < edge; ++z) {
        const std::array<double, 3> lower{offset + 0.1 * x, 0.1 * y - offset, 0.1 * z};
        boxes.push_back({lower, {lower[0] + 0.1, lower[1] + 0.1, lower[2] + 0.1}});
      }
    }
  }
  return boxes;
}

/// Edges of footprints, each of which begins where the last one ends.
[[nodiscard]] inline Boxes64 footprints(std::uint32_t seed, double easting, double northing) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> place(0, 800), length(-12, 12);
  Boxes64 boxes;
  for (int house = 0; house < 60; ++house) {
    std::array<double, 2> corner{easting + place(random), northing + place(random)};
    for (int edge = 0; edge < 5; ++edge) {
      const std::array<double, 2> next{corner[0] + length(random), corner[1] + length(random)};
      boxes.push_back({{std::min(corner[0], next[0]), std::min(corner[1], next[1]), 0},
                       {std::max(corner[0], next[0]), std::max(corner[1], next[1]), 0}});
      corner = next;
    }
  }
  return boxes;
}

/// Boxes on the grid of single precision, moved by half of its step at most.
[[nodiscard]] inline Boxes64 halves_of_steps(std::uint32_t seed, double offset) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> cell(0, 12), half(-1, 1);
  const double step =
      static_cast<double>(std::nextafter(static_cast<float>(offset + 1), 1e30F)) - (offset + 1);
  Boxes64 boxes(150);
  for (Aabb64& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = offset + step * (cell(random) + 0.5 * half(random));
      box.upper[axis] = box.lower[axis] + step * (4 + 0.5 * half(random));
    }
  }
  return boxes;
}

/// Each of these numbers as a bound, on one axis.
[[nodiscard]] inline Boxes64 special_boxes() {
  constexpr double least = std::numeric_limits<double>::denorm_min();
  constexpr double largest = std::numeric_limits<double>::max();
  const std::vector<double> bounds{-infinity64, -largest,  -1e300,  -1.0,      -1e-42, -least,
                                   -0.0,        0.0,       least,   1e-310,    1e-42,  1 - 1e-16,
                                   1.0,         1 + 3e-16, largest, infinity64};
  Boxes64 boxes;
  for (const double lower : bounds) {
    for (const double upper : bounds) boxes.push_back({{-1, lower, -1}, {1, upper, 1}});
  }
  return boxes;
}

}  // namespace broadcl::test
