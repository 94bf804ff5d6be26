#pragma once

/// Boxes of Eigen. Optional: the library itself does not need Eigen.

#include <Eigen/Geometry>

#include <broadcl/aabb.hpp>

namespace broadcl {

/// An empty Eigen box (its constructor makes lower bounds exceed upper ones) stays empty.
[[nodiscard]] inline Aabb to_aabb(const Eigen::AlignedBox3f& box) noexcept {
  return {{box.min().x(), box.min().y(), box.min().z()}, {box.max().x(), box.max().y(), box.max().z()}};
}

/// Rounds outward: see round_outward().
[[nodiscard]] inline Aabb to_aabb(const Eigen::AlignedBox3d& box) noexcept {
  return round_outward({box.min().x(), box.min().y(), box.min().z()},
                       {box.max().x(), box.max().y(), box.max().z()});
}

[[nodiscard]] inline Eigen::AlignedBox3f to_eigen(const Aabb& box) noexcept {
  return {Eigen::Vector3f(box.lower.data()), Eigen::Vector3f(box.upper.data())};
}

}  // namespace broadcl
