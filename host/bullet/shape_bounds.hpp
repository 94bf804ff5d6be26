#pragma once

#include <BulletCollision/CollisionDispatch/btCollisionObject.h>
#include <LinearMath/btVector3.h>

#include <array>
#include <optional>

namespace broadcl {

/// An oriented box with rounded edges that contains the shape of an object, its collision margin included.
struct ShapeBounds {
  btVector3 centre;
  std::array<btVector3, 3> axes;  ///< Orthonormal.
  btVector3 half;                 ///< Of the edges of the box before it is rounded, along its axes.
  btScalar radius;                ///< Of the rounding, which is added on all sides.
  btScalar breaking;              ///< At least the shape's contact breaking threshold.
  btScalar error;                 ///< At least what rounding errors amount to.
};

/// @param breaking gContactBreakingThreshold.
/// @returns None if the shape is not one of those of Bullet that are known to be bounded, or if the transform
///   is no rotation and translation.
[[nodiscard]] std::optional<ShapeBounds> bounds_of(const btCollisionObject& object, btScalar breaking);

/// Whether two shapes are so far apart that Bullet finds no contact. False if anything is NaN.
/// @param breaking gContactBreakingThreshold.
[[nodiscard]] bool are_apart(const ShapeBounds& s, const ShapeBounds& t, btScalar breaking);

/// The largest contact breaking threshold of a manifold for which are_apart() says the truth.
[[nodiscard]] inline btScalar largest_breaking(const ShapeBounds& s, const ShapeBounds& t) {
  return btScalar(1.25) * btMin(s.breaking, t.breaking);
}

}  // namespace broadcl
