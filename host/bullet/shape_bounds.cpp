#include "bullet/shape_bounds.hpp"

#include <BulletCollision/CollisionShapes/btBoxShape.h>
#include <BulletCollision/CollisionShapes/btCapsuleShape.h>
#include <BulletCollision/CollisionShapes/btConeShape.h>
#include <BulletCollision/CollisionShapes/btConvexHullShape.h>
#include <BulletCollision/CollisionShapes/btCylinderShape.h>
#include <BulletCollision/CollisionShapes/btMultiSphereShape.h>
#include <BulletCollision/CollisionShapes/btSphereShape.h>

#include <cmath>
#include <cstddef>
#include <typeinfo>

namespace broadcl {
namespace {

/// A rounded box in the local frame of a shape.
struct LocalBounds {
  btVector3 centre;
  btVector3 half;
  btScalar radius;
};

/// Whether an object is of exactly one of these classes, not of a derived class.
template <class... Classes>
bool is_exactly(const btCollisionShape& shape) {
  return ((typeid(shape) == typeid(Classes)) || ...);
}

LocalBounds aabb_of(const btCollisionShape& shape) {
  btVector3 lower;
  btVector3 upper;
  shape.getAabb(btTransform::getIdentity(), lower, upper);
  return {(lower + upper) / 2, (upper - lower) / 2, 0};
}

/// Whether a shape is not smaller than its margin. If it is, Bullet collides a shape that reaches farther.
bool has_core(const btVector3& half_without_margin) {
  return half_without_margin.x() >= 0 && half_without_margin.y() >= 0 && half_without_margin.z() >= 0;
}

/// Whether Bullet may collide a polyhedron in place of a shape. The polyhedron may be larger, or out of date.
bool has_polyhedron(const btPolyhedralConvexShape& shape) {
  return shape.getConvexPolyhedron() != nullptr;
}

std::optional<LocalBounds> local_bounds_of_box(const btBoxShape& box) {
  if (has_polyhedron(box) || !has_core(box.getHalfExtentsWithoutMargin())) return std::nullopt;
  return LocalBounds{btVector3(0, 0, 0), box.getHalfExtentsWithMargin().absolute(), 0};
}

LocalBounds local_bounds_of_sphere(const btSphereShape& sphere) {
  const btVector3 origin(0, 0, 0);
  return {origin, origin, btFabs(sphere.getRadius())};
}

LocalBounds local_bounds_of_capsule(const btCapsuleShape& capsule) {
  const btVector3 origin(0, 0, 0);
  LocalBounds bounds{origin, origin, btFabs(capsule.getRadius())};
  bounds.half[capsule.getUpAxis()] = btFabs(capsule.getHalfHeight());
  return bounds;
}

/// Bullet collides a round cylinder, even if the extents across its axis differ.
std::optional<LocalBounds> local_bounds_of_cylinder(const btCylinderShape& cylinder) {
  if (!has_core(cylinder.getHalfExtentsWithoutMargin())) return std::nullopt;
  const btVector3 extents = cylinder.getHalfExtentsWithMargin();
  const btScalar radius = cylinder.getRadius();
  btVector3 half(radius, radius, radius);
  half[cylinder.getUpAxis()] = extents[cylinder.getUpAxis()];
  half.setMax(extents);
  return LocalBounds{btVector3(0, 0, 0), half, 0};
}

std::optional<LocalBounds> local_bounds_of_cone(const btConeShape& cone) {
  if (!(cone.getRadius() >= 0 && cone.getHeight() >= 0)) return std::nullopt;  // negative scaling
  return aabb_of(cone);
}

std::optional<LocalBounds> local_bounds_of_spheres(const btMultiSphereShape& spheres) {
  const btVector3 scaling = spheres.getLocalScaling().absolute();
  for (int k = 0; k < spheres.getSphereCount(); ++k) {
    const btScalar least = spheres.getSphereRadius(k) * scaling[scaling.minAxis()];
    if (!(least >= spheres.getMargin())) return std::nullopt;  // as in has_core()
  }
  return aabb_of(spheres);
}

std::optional<LocalBounds> local_bounds_of_hull(const btConvexHullShape& hull) {
  if (has_polyhedron(hull)) return std::nullopt;
  return aabb_of(hull);
}

std::optional<LocalBounds> local_bounds_of(const btCollisionShape& shape) {
  switch (shape.getShapeType()) {
    case BOX_SHAPE_PROXYTYPE:
      if (!is_exactly<btBoxShape>(shape)) return std::nullopt;
      return local_bounds_of_box(static_cast<const btBoxShape&>(shape));
    case SPHERE_SHAPE_PROXYTYPE:
      if (!is_exactly<btSphereShape>(shape)) return std::nullopt;
      return local_bounds_of_sphere(static_cast<const btSphereShape&>(shape));
    case CAPSULE_SHAPE_PROXYTYPE:
      if (!is_exactly<btCapsuleShape, btCapsuleShapeX, btCapsuleShapeZ>(shape)) return std::nullopt;
      return local_bounds_of_capsule(static_cast<const btCapsuleShape&>(shape));
    case CYLINDER_SHAPE_PROXYTYPE:
      if (!is_exactly<btCylinderShape, btCylinderShapeX, btCylinderShapeZ>(shape)) return std::nullopt;
      return local_bounds_of_cylinder(static_cast<const btCylinderShape&>(shape));
    case CONE_SHAPE_PROXYTYPE:
      if (!is_exactly<btConeShape, btConeShapeX, btConeShapeZ>(shape)) return std::nullopt;
      return local_bounds_of_cone(static_cast<const btConeShape&>(shape));
    case MULTI_SPHERE_SHAPE_PROXYTYPE:
      if (!is_exactly<btMultiSphereShape>(shape)) return std::nullopt;
      return local_bounds_of_spheres(static_cast<const btMultiSphereShape&>(shape));
    case CONVEX_HULL_SHAPE_PROXYTYPE:
      if (!is_exactly<btConvexHullShape>(shape)) return std::nullopt;
      return local_bounds_of_hull(static_cast<const btConvexHullShape&>(shape));
    default:
      return std::nullopt;
  }
}

/// How far axes may deviate from orthonormal ones.
constexpr btScalar tolerance = btScalar(1e-5);

bool are_orthonormal(const std::array<btVector3, 3>& axes) {
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(btFabs(axes[i].dot(axes[i]) - 1) <= tolerance)) return false;
    if (!(btFabs(axes[i].dot(axes[(i + 1) % 3])) <= tolerance)) return false;
  }
  return true;
}

btScalar sum_of(const btVector3& v) {
  return btFabs(v.x()) + btFabs(v.y()) + btFabs(v.z());
}

}  // namespace

std::optional<ShapeBounds> bounds_of(const btCollisionObject& object, btScalar breaking) {
  const std::optional<LocalBounds> local = local_bounds_of(*object.getCollisionShape());
  if (!local) return std::nullopt;
  const btTransform& transform = object.getWorldTransform();
  const btMatrix3x3& basis = transform.getBasis();
  ShapeBounds bounds{.centre = transform(local->centre),
                     .axes = {basis.getColumn(0), basis.getColumn(1), basis.getColumn(2)},
                     .half = local->half,
                     .radius = local->radius,
                     .breaking = 0,
                     .error = 0};
  if (!are_orthonormal(bounds.axes)) return std::nullopt;
  // Computed like btCollisionShape::getAngularMotionDisc().
  const btVector3 edges = local->half + btVector3(local->radius, local->radius, local->radius);
  const btScalar disc = edges.length() + local->centre.length();
  bounds.breaking = breaking * btMax(btScalar(1), disc);
  const btScalar size = sum_of(edges) + sum_of(local->centre);
  bounds.error = 4 * tolerance * size + 32 * SIMD_EPSILON * (sum_of(transform.getOrigin()) + size);
  return bounds;
}

bool are_apart(const ShapeBounds& s, const ShapeBounds& t, btScalar breaking) {
  // A contact lives as long as its points are not farther apart than the threshold along the normal and
  // across it, and Bullet may turn a shape by so much that its surface moves by `breaking`.
  const btScalar least =
      btScalar(1.5) * btMin(s.breaking, t.breaking) + breaking + s.error + t.error + s.radius + t.radius;
  const btVector3 d = t.centre - s.centre;
  std::array<std::array<btScalar, 3>, 3> cosines;
  std::array<std::array<btScalar, 3>, 3> sizes;
  std::array<btScalar, 3> along_s;
  // Along the normals of the faces and the line between the centres.
  btScalar overlap = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    btScalar half_of_t = 0;
    for (std::size_t j = 0; j < 3; ++j) {
      cosines[i][j] = s.axes[i].dot(t.axes[j]);
      sizes[i][j] = btFabs(cosines[i][j]);
      half_of_t += t.half[static_cast<int>(j)] * sizes[i][j];
    }
    along_s[i] = d.dot(s.axes[i]);
    if (btFabs(along_s[i]) > s.half[static_cast<int>(i)] + half_of_t + least) return true;
    overlap += s.half[static_cast<int>(i)] * btFabs(along_s[i]);
  }
  for (std::size_t j = 0; j < 3; ++j) {
    const btScalar along_t = btFabs(d.dot(t.axes[j]));
    const btScalar half_of_s = s.half.x() * sizes[0][j] + s.half.y() * sizes[1][j] + s.half.z() * sizes[2][j];
    if (along_t > t.half[static_cast<int>(j)] + half_of_s + least) return true;
    overlap += t.half[static_cast<int>(j)] * along_t;
  }
  const btScalar square = d.length2();
  const btScalar gap = square - overlap;
  if (gap > 0 && gap * gap > least * least * square) return true;
  // Along the products of their edges, which are no longer than 1.
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t i1 = (i + 1) % 3;
    const std::size_t i2 = (i + 2) % 3;
    for (std::size_t j = 0; j < 3; ++j) {
      const std::size_t j1 = (j + 1) % 3;
      const std::size_t j2 = (j + 2) % 3;
      const btScalar of_s =
          s.half[static_cast<int>(i1)] * sizes[i2][j] + s.half[static_cast<int>(i2)] * sizes[i1][j];
      const btScalar of_t =
          t.half[static_cast<int>(j1)] * sizes[i][j2] + t.half[static_cast<int>(j2)] * sizes[i][j1];
      const btScalar distance = btFabs(along_s[i2] * cosines[i1][j] - along_s[i1] * cosines[i2][j]);
      if (distance > of_s + of_t + least) return true;
    }
  }
  return false;
}

}  // namespace broadcl
