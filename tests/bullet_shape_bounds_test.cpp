// The bounds that shape culling compares.
#include <BulletSoftBody/btSoftBody.h>
#include <BulletSoftBody/btSoftBodyHelpers.h>
#include <btBulletCollisionCommon.h>

#include <cmath>
#include <memory>
#include <optional>
#include <utility>

#include <gtest/gtest.h>

#include "bullet/shape_bounds.hpp"
#include "bullet_shapes.hpp"

namespace broadcl::test {
namespace {

/// Whether a shape is left alone.
bool is_unbounded(btCollisionShape& shape) {
  btCollisionObject object;
  object.setCollisionShape(&shape);
  return !bounds_of(object, gContactBreakingThreshold);
}

/// Bullet then collides another shape than the one that its box bounds.
TEST(ShapeBounds, AreNoneOfShapesThatReachBeyondTheirBoxes) {
  btBoxShape thin({0.5F, 0.5F, 0.03F});
  EXPECT_FALSE(is_unbounded(thin));
  thin.setMargin(0.1F);
  EXPECT_TRUE(is_unbounded(thin));

  btCylinderShape disc({0.5F, 0.03F, 0.5F});
  EXPECT_FALSE(is_unbounded(disc));
  disc.setMargin(0.1F);
  EXPECT_TRUE(is_unbounded(disc));

  Shapes shapes;
  EXPECT_FALSE(is_unbounded(shapes.spokes));
  shapes.spokes.setMargin(0.3F);
  EXPECT_TRUE(is_unbounded(shapes.spokes));

  EXPECT_FALSE(is_unbounded(shapes.cone));
  shapes.cone.setLocalScaling({1, -1, 1});
  EXPECT_TRUE(is_unbounded(shapes.cone));

  for (btPolyhedralConvexShape* shape : {static_cast<btPolyhedralConvexShape*>(&shapes.box),
                                         static_cast<btPolyhedralConvexShape*>(&shapes.hull)}) {
    EXPECT_FALSE(is_unbounded(*shape));
    shape->initializePolyhedralFeatures();
    EXPECT_TRUE(is_unbounded(*shape));
  }
}

/// Bullet collides a round one.
TEST(ShapeBounds, ContainCylindersWhoseExtentsDiffer) {
  btCylinderShape disc({1, 0.1F, 0.2F});
  btCylinderShapeX roll({0.1F, 1, 0.2F});
  btCylinderShapeZ wheel({1, 0.2F, 0.1F});
  btSphereShape ball(0.2F);
  for (const auto& [shape, place] : {std::pair<btCollisionShape*, btVector3>(&disc, {0, 0, 1.1F}),
                                     {&roll, {0, 0, 1.1F}},
                                     {&wheel, {0, 1.1F, 0}}}) {
    btCollisionObject round;
    round.setCollisionShape(shape);
    btCollisionObject beside;
    beside.setCollisionShape(&ball);
    beside.setWorldTransform(at(place));
    EXPECT_FALSE(are_apart(*bounds_of(round, 0.02F), *bounds_of(beside, 0.02F), 0.02F)) << shape->getName();
  }
}

TEST(ShapeBounds, AreThoseOfShapesThatAreKnownToBeBounded) {
  Shapes shapes;
  for (btCollisionShape* shape : shapes.bounded()) {
    btCollisionObject object;
    object.setCollisionShape(shape);
    object.setWorldTransform(at({1, 2, 3}, {1, 2, 3}));
    const std::optional<ShapeBounds> bounds = bounds_of(object, gContactBreakingThreshold);
    ASSERT_TRUE(bounds) << shape->getName();
    EXPECT_GE(bounds->breaking, shape->getContactBreakingThreshold(gContactBreakingThreshold) * 0.999F)
        << shape->getName();
  }
  for (btCollisionShape* shape : shapes.unbounded()) {
    btCollisionObject object;
    object.setCollisionShape(shape);
    object.setWorldTransform(at({1, 2, 3}));
    EXPECT_FALSE(bounds_of(object, gContactBreakingThreshold)) << shape->getName();
  }
  btSoftBodyWorldInfo info;
  const std::unique_ptr<btSoftBody> soft(btSoftBodyHelpers::CreateRope(info, {0, 0, 0}, {1, 0, 0}, 3, 0));
  EXPECT_FALSE(bounds_of(*soft, gContactBreakingThreshold));
}

/// At a distance of `touching` plus a gap along x, the objects are found apart with a gap of 0.12 but not of
/// 0.02.
void expect_tight(btCollisionShape& s, const btTransform& of_s, btCollisionShape& t, const btTransform& of_t,
                  btScalar touching) {
  for (const btScalar gap : {btScalar(0.02), btScalar(0.12)}) {
    btCollisionObject a;
    a.setCollisionShape(&s);
    a.setWorldTransform(of_s);
    btCollisionObject b;
    b.setCollisionShape(&t);
    b.setWorldTransform(at({touching + gap, 0, 0}) * of_t);
    EXPECT_EQ(are_apart(*bounds_of(a, 0.02F), *bounds_of(b, 0.02F), 0.02F), gap > 0.1F)
        << s.getName() << " and " << t.getName() << ", " << gap;
  }
}

TEST(ShapeBounds, AreTight) {
  btSphereShape ball(1);
  btBoxShape cube({0.5F, 0.5F, 0.5F});
  btBoxShape needle({0.01F, 0.5F, 0.01F});
  btCapsuleShape capsule(0.3F, 1);
  const btTransform straight = at({0, 0, 0});
  const btTransform tilted = at({0, 0, 0}, {1, 2, 3});
  const btTransform on_edge = at({0, 0, 0}, btQuaternion({0, 0, 1}, SIMD_PI / 4));
  const btTransform on_side = at({0, 0, 0}, btQuaternion({0, 1, 0}, SIMD_PI / 4));
  const btTransform flat = at({0, 0, 0}, btQuaternion({0, 0, 1}, SIMD_PI / 2));
  expect_tight(ball, straight, ball, on_edge, 2);
  expect_tight(ball, tilted, ball, tilted, 2);
  expect_tight(cube, straight, cube, straight, 1);
  expect_tight(cube, straight, cube, on_edge, 0.5F + std::sqrt(0.5F));
  expect_tight(cube, on_side, cube, on_edge, 2 * std::sqrt(0.5F));  // crossing edges
  expect_tight(capsule, straight, capsule, straight, 0.6F);
  expect_tight(capsule, straight, capsule, flat, 1.1F);
  expect_tight(ball, straight, capsule, flat, 1.8F);
  expect_tight(ball, straight, cube, on_edge, 1 + std::sqrt(0.5F));
  expect_tight(needle, straight, needle, on_edge, 0.01F + 0.51F * std::sqrt(0.5F));
}

}  // namespace
}  // namespace broadcl::test
