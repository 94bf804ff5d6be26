#pragma once

#include <cstddef>
#include <cstring>

#include <broadcl/aabb.hpp>

#include "base/lanes.hpp"

namespace broadcl::mpi {

/// Three floats, and one that does not count.
using Lanes = FourLanes;

/// A box, for comparisons without branches.
struct Corners {
  Corners() = default;
  explicit Corners(const Aabb& box) noexcept {
    std::memcpy(&lower, &box, sizeof lower);
    Lanes last{};
    std::memcpy(&last, &box.lower[2], sizeof last);  // and the upper bounds
    upper = __builtin_shufflevector(last, last, 1, 2, 3, 3);
  }
  [[nodiscard]] Lanes centroid() const noexcept { return 0.5F * lower + 0.5F * upper; }

  Lanes lower{}, upper{};
};

/// Of packed boxes.
[[nodiscard]] inline bool contains(const Corners& outer, const Corners& inner) noexcept {
  const auto is_within = (outer.lower <= inner.lower) & (inner.upper <= outer.upper);
  return (is_within[0] & is_within[1] & is_within[2]) != 0;
}

/// Whether two packed boxes overlap.
[[nodiscard]] inline bool meet(const Corners& s, const Corners& t) noexcept {
  const auto do_meet = (s.lower <= t.upper) & (t.lower <= s.upper);
  return (do_meet[0] & do_meet[1] & do_meet[2]) != 0;
}

}  // namespace broadcl::mpi
