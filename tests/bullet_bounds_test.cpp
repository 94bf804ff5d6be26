// Objects whose bounds are infinite, empty or NaN in a running world, with BroadCL's broad phase and with
// Bullet's own.
#include <btBulletDynamicsCommon.h>

#include <broadcl/bullet.hpp>

#include <array>
#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "bullet_contract.hpp"
#include "bullet_rig.hpp"
#include "rigid_world.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

using test::grid_cell;
using test::height;
using test::kinds;
using test::RigidWorld;
using test::state;

/// A user's shape of infinite size.
class EndlessShape final : public btEmptyShape {
 public:
  void getAabb(const btTransform& /*transform*/, btVector3& aabbMin, btVector3& aabbMax) const override {
    const btScalar infinity = std::numeric_limits<btScalar>::infinity();
    aabbMin = {-infinity, -infinity, -infinity};
    aabbMax = {infinity, infinity, infinity};
  }
};

constexpr int lonely_cubes = 25;

/// Cubes that fall on a floor and tumble there, each alone: nothing else in the world affects them.
void add_lonely_cubes(RigidWorld& world) {
  world.bodies.add_floor();
  for (int k = 0; k < lonely_cubes; ++k) {
    btRigidBody& cube = world.bodies.add_cube(3 * grid_cell(k, 5, 1) + btVector3(0, 2, 0));
    cube.setAngularVelocity({btScalar(k) / 5, 2, 1});
  }
}

/// Two worlds on broad phases of one kind, with lonely cubes in both.
class Bounds : public test::Contract {
 protected:
  Bounds() {
    for (RigidWorld* world : {&world_, &plain_}) add_lonely_cubes(*world);
    if (auto* ours = dynamic_cast<BulletBroadphase*>(broadphase_.get())) {
      ours->set_error_handler([this](const std::string& error) { errors_.push_back(error); });
    }
  }

  void step(int times = 1) {
    for (int k = 0; k < times; ++k) {
      for (RigidWorld* world : {&world_, &plain_}) world->step();
      test::expect_right_pairs(world_.world, GetParam());
    }
  }
  /// The cubes of both worlds have the same state, bit for bit.
  void expect_same_cubes() {
    const std::size_t count = 1 + lonely_cubes;
    EXPECT_EQ(state(world_, count), state(plain_, count));
    EXPECT_GT(height(*world_.bodies.all()[1]), 0.3F);
  }
  /// Bullet's own broad phases report nothing.
  void expect_errors(std::size_t count) {
    if (GetParam().name == "BroadCL") {
      EXPECT_EQ(errors_.size(), count);
    }
  }

  std::vector<std::string> errors_;
  std::unique_ptr<btBroadphaseInterface> broadphase_ = GetParam().make(nullptr);
  std::unique_ptr<btBroadphaseInterface> plain_broadphase_ = GetParam().make(nullptr);
  RigidWorld world_{*broadphase_};  // the one that is changed
  RigidWorld plain_{*plain_broadphase_};
};

INSTANTIATE_TEST_SUITE_P(World, Bounds, testing::ValuesIn(kinds), test::named_by_parameter);

TEST_P(Bounds, EmptyAndEndlessShapesLeaveOthersAlone) {
  btEmptyShape empty;
  btCompoundShape no_children;
  EndlessShape endless;
  btStaticPlaneShape plane({1, 0, 0}, -500);
  const std::array<btCollisionShape*, 4> shapes{&empty, &no_children, &endless, &plane};
  for (btCollisionShape* shape : shapes) world_.bodies.add(*shape, 0, {4, 1, 4});
  step(90);
  expect_same_cubes();
  for (int k = 0; k < 4; ++k) world_.bodies.remove(*world_.bodies.all().back());
  step(30);
  expect_same_cubes();
  expect_errors(0);
}

const btTransform nowhere(btQuaternion::getIdentity(),
                          btVector3(0, std::numeric_limits<btScalar>::quiet_NaN(), 0));

btTransform at(const btVector3& position) {
  return btTransform(btQuaternion::getIdentity(), position);
}

// Bullet checks only the boxes of dynamic objects before it passes them on.
TEST_P(Bounds, AStaticBodyThatTurnsInvalidIsReportedAndLeavesOthersAlone) {
  btBoxShape shape({1, 1, 1});
  btRigidBody& invalid = world_.bodies.add(shape, 0, {50, 1, 0});
  btRigidBody& faller = world_.bodies.add_cube({80, 40, 0});
  step(20);
  expect_errors(0);
  for (std::size_t turn = 1; turn <= 3; ++turn) {
    invalid.setWorldTransform(nowhere);
    step(20);
    expect_errors(turn);
    invalid.setWorldTransform(at({80, 1, 0}));
    faller.setWorldTransform(at({80, 2.6F, 0}));
    faller.setLinearVelocity({0, 0, 0});
    faller.activate();
    step(20);
    expect_errors(turn);
    EXPECT_NEAR(height(faller), 2.5, 0.05) << "the repaired body supports others";
    invalid.setWorldTransform(at({50, 1, 0}));
    faller.setWorldTransform(at({80, 40, 0}));
  }
  for (const std::string& error : errors_) {
    EXPECT_THAT(error, testing::StartsWith("proxy " +
                                           std::to_string(invalid.getBroadphaseHandle()->m_uniqueId) + " "));
  }
  expect_same_cubes();
}

TEST_P(Bounds, ABodyThatStartsInvalidIsReportedAndLeavesOthersAlone) {
  if (unfit("Sweep", "cannot sort a NaN among the ends, and loses pairs of others")) return;
  btRigidBody& invalid = world_.bodies.add_cube(nowhere.getOrigin());
  expect_errors(1);
  step(90);
  expect_errors(1);
  expect_same_cubes();
  world_.bodies.remove(invalid);
  step(30);
  expect_same_cubes();
  const btRigidBody& next = world_.bodies.add_cube({80, 0.5F, 0});
  step(30);
  EXPECT_NEAR(height(next), 0.5, 0.05);
  expect_same_cubes();
}

// Bullet disables its simulation; the broad phase never receives the invalid box and keeps the last valid
// one.
TEST_P(Bounds, ADynamicBodyThatTurnsInvalidIsKeptFromTheBroadPhase) {
  btRigidBody& invalid = world_.bodies.add_cube({50, 10, 0});
  step(20);
  invalid.setWorldTransform(nowhere);
  step(20);
  EXPECT_EQ(invalid.getActivationState(), DISABLE_SIMULATION);
  EXPECT_GT(invalid.getBroadphaseHandle()->m_aabbMin.y(), 5);
  expect_errors(0);
  expect_same_cubes();
  invalid.setWorldTransform(at({50, 0.5F, 0}));
  invalid.setInterpolationWorldTransform(invalid.getWorldTransform());
  invalid.setLinearVelocity({0, 0, 0});
  invalid.forceActivationState(ACTIVE_TAG);
  step(20);
  EXPECT_NEAR(height(invalid), 0.5, 0.05);
  expect_same_cubes();
}

}  // namespace
}  // namespace broadcl
