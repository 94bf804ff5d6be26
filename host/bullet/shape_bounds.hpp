#pragma once

#include <BulletCollision/CollisionDispatch/btCollisionObject.h>
#include <LinearMath/btVector3.h>

#include <array>
#include <optional>

namespace broadcl {

/// An oriented box with rounded edges that contains the shape of an object, including its collision margin.
struct ShapeBounds {
  btVector3 centre;
  std::array<btVector3, 3> axes;  ///< Orthonormal.
  btVector3 half;                 ///< Of the edges of the box before it is rounded, along its axes.
  btScalar radius;                ///< Of the rounded edges; added on all sides.
  btScalar breaking;              ///< At least the shape's contact breaking threshold.
  btScalar error;                 ///< Upper bound of the rounding errors.
};

/// @param breaking gContactBreakingThreshold.
/// @returns None if the shape is not of a supported class of Bullet, or if the transform is not a rotation
/// and translation.
[[nodiscard]] std::optional<ShapeBounds> bounds_of(const btCollisionObject& object, btScalar breaking);

/// Whether two shapes are so far apart that Bullet finds no contact. False if anything is NaN.
/// @param breaking gContactBreakingThreshold.
[[nodiscard]] bool are_apart(const ShapeBounds& s, const ShapeBounds& t, btScalar breaking);

/// The largest contact breaking threshold of a manifold for which the result of are_apart() is valid.
[[nodiscard]] inline btScalar largest_breaking(const ShapeBounds& s, const ShapeBounds& t) {
  return btScalar(1.25) * btMin(s.breaking, t.breaking);
}

}  // namespace broadcl
