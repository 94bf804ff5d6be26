// BroadCL's broad phase and Bullet's own in every kind of world that Bullet has, and with sensors and
// characters that move in them.
#include <BulletCollision/CollisionDispatch/btCollisionDispatcherMt.h>
#include <BulletCollision/CollisionDispatch/btGhostObject.h>
#include <BulletDynamics/Character/btKinematicCharacterController.h>
#include <BulletDynamics/ConstraintSolver/btSequentialImpulseConstraintSolverMt.h>
#include <BulletDynamics/Dynamics/btDiscreteDynamicsWorldMt.h>
#include <BulletDynamics/Featherstone/btMultiBody.h>
#include <BulletDynamics/Featherstone/btMultiBodyConstraintSolver.h>
#include <BulletDynamics/Featherstone/btMultiBodyDynamicsWorld.h>
#include <BulletDynamics/Featherstone/btMultiBodyLinkCollider.h>
#include <LinearMath/btThreads.h>
#include <btBulletDynamicsCommon.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "bullet_contract.hpp"
#include "bullet_rig.hpp"
#include "rigid_world.hpp"
#include "runs.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

using test::expect_right_pairs;
using test::grid_cell;
using test::kinds;
using test::Random;
using test::RigidBodies;
using test::RigidWorld;
using test::time_step;

class Worlds : public test::Contract {
 protected:
  std::unique_ptr<btBroadphaseInterface> broadphase_ = GetParam().make(nullptr);
};

INSTANTIATE_TEST_SUITE_P(World, Worlds, testing::ValuesIn(kinds), test::named_by_parameter);

/// Three towers of five cubes, a little apart, on the floor.
void build_towers(RigidBodies& bodies) {
  bodies.add_floor();
  for (int k = 0; k < 15; ++k) {
    bodies.add_cube(grid_cell(k, 3, 5) * btVector3(3, 1.05F, 0) + btVector3(0, 0.5F, 0));
  }
}

void expect_towers(const RigidBodies& bodies) {
  for (std::size_t k = 0; k < 15; ++k) {
    const btVector3 cell = grid_cell(static_cast<int>(k), 3, 5);
    const btVector3& position = bodies.all()[k + 1]->getWorldTransform().getOrigin();
    EXPECT_NEAR(position.x(), 3 * cell.x(), 0.1);
    EXPECT_NEAR(position.y(), cell.y() + btScalar(0.5), 0.1);
  }
}

TEST_P(Worlds, OfRigidBodies) {
  RigidWorld world(*broadphase_);
  build_towers(world.bodies);
  for (int frame = 0; frame < 120; ++frame) {
    world.step();
    expect_right_pairs(world.world, GetParam());
  }
  expect_towers(world.bodies);
}

// Debian's Bullet is built without threads: with it, these classes do their work one after the other.
NOT_IN(sanitizers, "takes long");
TEST_P(Worlds, OfRigidBodiesWithTheClassesForThreads) {
  btSetTaskScheduler(btGetSequentialTaskScheduler());
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcherMt dispatcher(&configuration);
  btConstraintSolverPoolMt solvers(2);
  btSequentialImpulseConstraintSolverMt solver;
  btDiscreteDynamicsWorldMt world(&dispatcher, broadphase_.get(), &solvers, &solver, &configuration);
  RigidBodies bodies(world);
  build_towers(bodies);
  for (int frame = 0; frame < 120; ++frame) {
    world.stepSimulation(time_step, 0, time_step);
    expect_right_pairs(world, GetParam());
  }
  expect_towers(bodies);
}

TEST_P(Worlds, OfMultiBodies) {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btMultiBodyConstraintSolver solver;
  btMultiBodyDynamicsWorld world(&dispatcher, broadphase_.get(), &solver, &configuration);
  RigidBodies bodies(world);
  bodies.add_floor();
  btRigidBody& target = bodies.add_cube({0, 0.5F, 0});
  btBoxShape shape({0.4F, 0.2F, 0.4F});
  // A chain of four links over the cube.
  constexpr int links = 3;
  btMultiBody chain(links, 1, {1, 1, 1}, false, false);
  chain.setBasePos({-1, 3, 0});
  for (int k = 0; k < links; ++k) {
    chain.setupRevolute(k, 1, {1, 1, 1}, k - 1, btQuaternion::getIdentity(), {0, 0, 1}, {0.5F, 0, 0},
                        {0.5F, 0, 0}, true);
  }
  chain.finalizeMultiDof();
  world.addMultiBody(&chain);
  std::vector<std::unique_ptr<btMultiBodyLinkCollider>> colliders;
  for (int link = -1; link < links; ++link) {
    colliders.push_back(std::make_unique<btMultiBodyLinkCollider>(&chain, link));
    colliders.back()->setCollisionShape(&shape);
    world.addCollisionObject(colliders.back().get(), 64, ~64);  // links do not collide with each other
    if (link < 0) {
      chain.setBaseCollider(colliders.back().get());
    } else {
      chain.getLink(link).m_collider = colliders.back().get();
    }
  }
  bool touched = false;
  for (int frame = 0; frame < 200; ++frame) {
    world.stepSimulation(time_step, 0);
    expect_right_pairs(world, GetParam());
    touched |= colliders.front()->getWorldTransform().getOrigin().y() < 1;
  }
  EXPECT_TRUE(touched);
  for (const auto& collider : colliders) {
    EXPECT_GT(collider->getWorldTransform().getOrigin().y(), 0.1F) << "nothing falls through the floor";
    world.removeCollisionObject(collider.get());
  }
  EXPECT_GT(target.getWorldTransform().getOrigin().y(), 0.4F);
  world.removeMultiBody(&chain);
}

/// Balls without dynamics, moved about at random.
class Balls {
 public:
  explicit Balls(btCollisionWorld& world) : world_(world), objects_(50) {
    for (btCollisionObject& object : objects_) {
      object.setCollisionShape(&shape_);
      object.setWorldTransform(btTransform(btQuaternion::getIdentity(), random_.point(8)));
      world.addCollisionObject(&object);
    }
  }
  ~Balls() {
    for (btCollisionObject& object : objects_) world_.removeCollisionObject(&object);
  }
  Balls(const Balls&) = delete;
  Balls& operator=(const Balls&) = delete;
  Balls(Balls&&) = delete;
  Balls& operator=(Balls&&) = delete;

  using Touching = std::set<std::pair<const btCollisionObject*, const btCollisionObject*>>;

  void move() {
    for (btCollisionObject& object : objects_) object.getWorldTransform().setOrigin(random_.point(8));
  }
  /// Those that touch, by the distances of their centres.
  [[nodiscard]] Touching touching() const {
    Touching result;
    for (const btCollisionObject& s : objects_) {
      for (const btCollisionObject& t : objects_) {
        const btVector3 d = s.getWorldTransform().getOrigin() - t.getWorldTransform().getOrigin();
        if (&s < &t && d.length() < 2 * shape_.getRadius()) result.emplace(&s, &t);
      }
    }
    return result;
  }
  [[nodiscard]] std::vector<btCollisionObject>& objects() { return objects_; }

 private:
  btCollisionWorld& world_;
  btSphereShape shape_{0.83F};  // coordinates are tenths, so no two balls just touch
  Random random_{1};
  std::vector<btCollisionObject> objects_;
};

TEST_P(Worlds, OfCollisionAlone) {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btCollisionWorld world(&dispatcher, broadphase_.get(), &configuration);
  Balls balls(world);
  std::size_t most = 0;
  for (int frame = 0; frame < 60; ++frame) {
    balls.move();
    world.performDiscreteCollisionDetection();
    expect_right_pairs(world, GetParam());
    Balls::Touching found;
    for (int k = 0; k < dispatcher.getNumManifolds(); ++k) {
      const btPersistentManifold& manifold = *dispatcher.getManifoldByIndexInternal(k);
      if (manifold.getNumContacts() > 0) found.insert(std::minmax(manifold.getBody0(), manifold.getBody1()));
    }
    ASSERT_EQ(found, balls.touching()) << "frame " << frame;
    most = std::max(most, found.size());
  }
  EXPECT_GT(most, 20U);
}

TEST_P(Worlds, WithASensorThatIsMoved) {
  btGhostPairCallback ghosts;
  broadphase_->getOverlappingPairCache()->setInternalGhostPairCallback(&ghosts);
  RigidWorld world(*broadphase_);
  world.world.setGravity({0, 0, 0});
  Random random(2);
  for (int k = 0; k < 60; ++k) world.bodies.add_cube(random.point(30) + btVector3(0.05F, 0, 0));
  btBoxShape zone({3, 20, 20});
  btPairCachingGhostObject sensor;
  sensor.setCollisionShape(&zone);
  sensor.setCollisionFlags(btCollisionObject::CF_NO_CONTACT_RESPONSE);
  world.world.addCollisionObject(&sensor);
  std::size_t most = 0;
  for (int frame = 0; frame < 60; ++frame) {
    sensor.getWorldTransform().setOrigin({btScalar(frame) / 2, 10, 10});
    world.step();
    std::set<const btCollisionObject*> seen;
    for (int k = 0; k < sensor.getNumOverlappingObjects(); ++k) seen.insert(sensor.getOverlappingObject(k));
    std::set<const btCollisionObject*> inside;
    const btBroadphaseProxy& own = *sensor.getBroadphaseHandle();
    for (const auto& body : world.bodies.all()) {
      const btBroadphaseProxy& proxy = *body->getBroadphaseHandle();
      if (TestAabbAgainstAabb2(own.m_aabbMin, own.m_aabbMax, proxy.m_aabbMin, proxy.m_aabbMax)) {
        inside.insert(body.get());
      }
    }
    EXPECT_TRUE(std::includes(seen.begin(), seen.end(), inside.begin(), inside.end()));
    if (GetParam().name == "BroadCL") {
      EXPECT_EQ(seen, inside) << "no outdated ones";
    }
    most = std::max(most, inside.size());
  }
  EXPECT_GT(most, 10U);
  world.world.removeCollisionObject(&sensor);
}

/// A capsule that walks along x on blocks that lie on a floor.
class Walk {
 public:
  explicit Walk(btBroadphaseInterface& broadphase) : world_(broadphase) {
    broadphase.getOverlappingPairCache()->setInternalGhostPairCallback(&ghosts_);
    world_.bodies.add_floor();
    ghost_.setCollisionShape(&capsule_);
    ghost_.setCollisionFlags(btCollisionObject::CF_CHARACTER_OBJECT);
    world_.world.addCollisionObject(&ghost_, btBroadphaseProxy::CharacterFilter,
                                    btBroadphaseProxy::StaticFilter | btBroadphaseProxy::DefaultFilter);
    world_.world.addAction(&character_);
    character_.warp({0, 1.1F, 0});
  }
  ~Walk() {
    world_.world.removeAction(&character_);
    world_.world.removeCollisionObject(&ghost_);
  }
  Walk(const Walk&) = delete;
  Walk& operator=(const Walk&) = delete;
  Walk(Walk&&) = delete;
  Walk& operator=(Walk&&) = delete;

  /// A static block on the floor, from x to x + length.
  void add_block(btScalar x, btScalar length, btScalar height) {
    shapes_.push_back(std::make_unique<btBoxShape>(btVector3(length / 2, height / 2, 3)));
    world_.bodies.add(*shapes_.back(), 0, {x + length / 2, height / 2, 0});
  }
  RigidWorld& world() { return world_; }
  btKinematicCharacterController& character() { return character_; }
  [[nodiscard]] const btVector3& position() const { return ghost_.getWorldTransform().getOrigin(); }

 private:
  std::vector<std::unique_ptr<btBoxShape>> shapes_;
  btGhostPairCallback ghosts_;
  RigidWorld world_;
  btCapsuleShape capsule_{0.5F, 1};  // it stands with its centre at a height of 1
  btPairCachingGhostObject ghost_;
  btKinematicCharacterController character_{&ghost_, &capsule_, 0.5F, {0, 1, 0}};
};

TEST_P(Worlds, WithACharacterThatWalksOverBlocksAndUpAStepToAWall) {
  Walk walk(*broadphase_);
  walk.add_block(2, 0.5F, 0.2F);
  walk.add_block(3, 0.3F, 0.3F);
  walk.add_block(6, 6, 0.4F);
  walk.add_block(9, 1, 3);
  walk.world().step(30);
  EXPECT_NEAR(walk.position().y(), 1, 0.1);
  walk.character().setWalkDirection({0.05F, 0, 0});
  btScalar highest = 0;
  for (int frame = 0; frame < 240; ++frame) {
    walk.world().step();
    if (walk.position().x() < 4) highest = std::max(highest, walk.position().y());
  }
  EXPECT_NEAR(highest, 1.3, 0.15) << "over the blocks";
  EXPECT_NEAR(walk.position().x(), 8.5, 0.1) << "no farther than the wall";
  EXPECT_NEAR(walk.position().y(), 1.4, 0.1) << "on the step";
}

TEST_P(Worlds, WithACharacterThatIsPushedOutOfAWallInTheNextStep) {
  Walk walk(*broadphase_);
  walk.add_block(2, 3, 3);
  walk.world().step(10);
  walk.character().warp({1.9F, 1.1F, 0});
  walk.world().step();
  EXPECT_LT(walk.position().x(), 1.75F);
}

TEST_P(Worlds, WithACharacterThatIsPushedOutOfAWallWithoutAStep) {
  fails("BroadCL", "its pairs form in the calculation");
  fails("Simple", "its pairs form in the calculation");
  Walk walk(*broadphase_);
  walk.add_block(2, 3, 3);
  walk.world().step(10);
  walk.character().warp({1.9F, 1.1F, 0});
  walk.character().updateAction(&walk.world().world, time_step);
  EXPECT_LT(walk.position().x(), 1.75F);
}

}  // namespace
}  // namespace broadcl
