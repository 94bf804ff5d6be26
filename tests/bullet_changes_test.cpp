// Changes that users make to a running world, with BroadCL's broad phase and with Bullet's own.
#include <btBulletDynamicsCommon.h>

#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "bullet_contract.hpp"
#include "bullet_rig.hpp"
#include "rigid_world.hpp"
#include "runs.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

using test::grid_cell;
using test::kinds;
using test::Random;
using test::RigidWorld;
using test::state;

class Changes : public test::Contract {
 protected:
  /// To be called after a step of the world.
  void expect_right_pairs(RigidWorld& world) { test::expect_right_pairs(world.world, GetParam()); }

  std::unique_ptr<btBroadphaseInterface> broadphase_ = GetParam().make(nullptr);
};

INSTANTIATE_TEST_SUITE_P(World, Changes, testing::ValuesIn(kinds), test::named_by_parameter);

/// Cubes that fall on a floor.
void add_falling_cubes(RigidWorld& world, int count) {
  Random random(1);
  world.bodies.add_floor();
  for (int k = 0; k < count; ++k) world.bodies.add_cube(random.point(8) + btVector3(0, 1, 0));
}

NOT_IN(sanitizers, "takes long");
TEST_P(Changes, ThousandsOfObjectsComeAndGoInOneFrame) {
  if (unfit("Sweep", "crashes when it is full") || unfit("Simple", "stops the program when it is full"))
    return;
  RigidWorld world(*broadphase_);
  const auto add = [&](int count, btScalar y) {
    for (int k = 0; k < count; ++k) {
      world.bodies.add_cube(grid_cell(k, 70, 1) * btVector3(1.2F, 0, 0.9F) + btVector3(0, y, 0));
    }
  };
  const auto pair_count = [&] { return broadphase_->getOverlappingPairCache()->getNumOverlappingPairs(); };
  constexpr int many = 5000;
  add(many, 0);
  world.step();
  expect_right_pairs(world);
  EXPECT_GE(pair_count(), many - 70);  // each touches the next in its row
  for (int k = 0; k < many; ++k) world.bodies.remove(*world.bodies.all().back());
  EXPECT_EQ(pair_count(), 0);
  add(many, 100);
  world.step();
  expect_right_pairs(world);
  EXPECT_GE(pair_count(), many - 70);
  for (int k = 0; k < many; ++k) world.bodies.remove(*world.bodies.all().back());
  world.step();
  EXPECT_EQ(pair_count(), 0);
}

TEST_P(Changes, BodiesMayLeapAnywhere) {
  RigidWorld world(*broadphase_);
  add_falling_cubes(world, 60);
  Random random(3);
  for (int frame = 0; frame < 60; ++frame) {
    for (int k = 0; k < 10; ++k) {
      btRigidBody& body = *world.bodies.all()[1 + random.below(60)];
      const auto distance = static_cast<btScalar>(frame % 3 == 0 ? 900 : 8);
      body.setCenterOfMassTransform(
          btTransform(btQuaternion::getIdentity(), random.point(8) * (distance / 8) + btVector3(0, 1, 0)));
      body.setInterpolationWorldTransform(body.getWorldTransform());
      body.setLinearVelocity({0, 0, 0});
    }
    world.step();
    expect_right_pairs(world);
  }
}

TEST_P(Changes, AMoverWakesWhatGotNoBoxForLong) {
  RigidWorld world(*broadphase_);
  world.world.setForceUpdateAllAabbs(false);
  world.bodies.add_floor();
  std::vector<btRigidBody*> row;
  row.reserve(10);
  for (int k = 0; k < 10; ++k) row.push_back(&world.bodies.add_cube({btScalar(1.01) * btScalar(k), 0.5F, 0}));
  world.step(240);
  for (const btRigidBody* cube : row) EXPECT_EQ(cube->getActivationState(), ISLAND_SLEEPING);
  expect_right_pairs(world);
  btRigidBody& ball = world.bodies.add_cube({-30, 0.6F, 0});
  ball.setLinearVelocity({20, 0, 0});
  ball.setFriction(0);
  const btScalar before = row.back()->getWorldTransform().getOrigin().x();
  for (int frame = 0; frame < 150; ++frame) {
    world.step();
    expect_right_pairs(world);
  }
  EXPECT_GT(row.back()->getWorldTransform().getOrigin().x(), before + btScalar(0.02));
}

TEST_P(Changes, AWorldBuiltAgainOnTheSameBroadPhaseGoesTheSameWay) {
  if (unfit("Tree", "compares addresses of nodes when it balances, so that it depends on the heap")) return;
  fails("Simple", "it has no reset, and gives ids back in the order of destruction");
  std::vector<btScalar> first;
  Random random(4);
  for (int life = 0; life < 10; ++life) {
    RigidWorld world(*broadphase_);
    add_falling_cubes(world, 40);
    world.step(60);
    expect_right_pairs(world);
    if (life == 0) first = state(world, 41);
    EXPECT_EQ(state(world, 41), first) << "life " << life;
    for (unsigned left = 41; left > 0; --left) world.bodies.remove(*world.bodies.all()[random.below(left)]);
    EXPECT_EQ(broadphase_->getOverlappingPairCache()->getNumOverlappingPairs(), 0);
    broadphase_->resetPool(nullptr);
  }
}

}  // namespace
}  // namespace broadcl
