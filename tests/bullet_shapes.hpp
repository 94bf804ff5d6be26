#pragma once

#include <BulletCollision/CollisionShapes/btBox2dShape.h>
#include <btBulletCollisionCommon.h>

#include <array>
#include <memory>
#include <vector>

#include "bullet_rig.hpp"

namespace broadcl::test {

inline btTransform at(const btVector3& position, const btQuaternion& rotation = btQuaternion::getIdentity()) {
  return btTransform(rotation, position);
}

/// A user's class: a box that might have contacts of its own, which only the user knows.
class UsersBox final : public btBoxShape {
 public:
  using btBoxShape::btBoxShape;
};

/// Shapes of all kinds, about 1 in size.
struct Shapes {
  Shapes() {
    Random random(1);
    for (int k = 0; k < 12; ++k) hull.addPoint(random.point(1) - btVector3(0.2F, 0.5F, 0.5F));
    compound.addChildShape(at({0.4F, 0, 0}), &small);
    compound.addChildShape(at({-0.4F, 0, 0}), &ball);
    for (const btVector3& corner : {btVector3(0, 0, 0), btVector3(1, 0, 0), btVector3(0, 1, 0)}) {
      triangles.addTriangle(corner, corner + btVector3(0, 0.5F, 1), corner + btVector3(1, 0, 0.5F));
    }
    mesh = std::make_unique<btBvhTriangleMeshShape>(&triangles, true);
    scaled.setLocalScaling({1, 2, 0.5F});
  }
  [[nodiscard]] std::vector<btCollisionShape*> bounded() {
    return {&box,      &small, &flat,   &ball,   &upright, &along_x, &along_z,
            &cylinder, &cone,  &cone_x, &spokes, &hull,    &scaled,  &large};
  }
  [[nodiscard]] std::vector<btCollisionShape*> unbounded() {
    return {&compound, mesh.get(), &plane, &users, &flat_world, &empty};
  }

  btBoxShape box{{0.5F, 0.5F, 0.5F}};
  btBoxShape small{{0.2F, 0.1F, 0.3F}};
  btBoxShape flat{{1.5F, 0.05F, 1}};
  btBoxShape large{{4, 0.5F, 3}};  // its contact breaking threshold is 0.1
  btBoxShape scaled{{0.5F, 0.2F, 0.7F}};
  btSphereShape ball{0.4F};
  btCapsuleShape upright{0.2F, 1};
  btCapsuleShapeX along_x{0.3F, 0.5F};
  btCapsuleShapeZ along_z{0.1F, 1.5F};
  btCylinderShape cylinder{{0.4F, 0.3F, 0.4F}};
  btConeShape cone{0.5F, 1};
  btConeShapeX cone_x{0.3F, 0.7F};
  std::array<btVector3, 2> centres{btVector3(-0.5F, 0, 0), btVector3(0.5F, 0.3F, 0)};
  std::array<btScalar, 2> radii{0.2F, 0.4F};
  btMultiSphereShape spokes{centres.data(), radii.data(), 2};
  btConvexHullShape hull;
  btCompoundShape compound;
  btTriangleMesh triangles;
  std::unique_ptr<btBvhTriangleMeshShape> mesh;
  btStaticPlaneShape plane{{0, 1, 0}, -3};
  UsersBox users{{0.5F, 0.5F, 0.5F}};
  btBox2dShape flat_world{{0.5F, 0.5F, 0.5F}};
  btEmptyShape empty;
};

}  // namespace broadcl::test
