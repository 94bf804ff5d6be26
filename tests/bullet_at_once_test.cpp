#include <BulletCollision/CollisionDispatch/btGhostObject.h>
#include <BulletDynamics/Character/btKinematicCharacterController.h>
#include <btBulletDynamicsCommon.h>

#include <memory>

#include <gtest/gtest.h>

#include "bullet_contract.hpp"

namespace broadcl {
namespace {

using test::all_bits;
using test::GhostRecorder;
using test::Kind;
using test::kinds;
using test::Rig;

const Kind& at_once = kinds[4];

TEST(BulletAtOnce, PairsComeWithTheBoxAndGoInTheCalculation) {
  Rig rig(at_once);
  GhostRecorder counter;
  rig.cache().setInternalGhostPairCallback(&counter);
  btBroadphaseProxy* s = rig.create_unit(0);
  btBroadphaseProxy* t = rig.create_unit(1);
  EXPECT_TRUE(rig.has(s, t)) << "created";
  btBroadphaseProxy* u = rig.create_unit(5);
  EXPECT_EQ(rig.pair_count(), 1);
  rig.move(u, 1.5F);
  EXPECT_TRUE(rig.has(t, u)) << "moved";
  rig.move(u, 5);
  EXPECT_TRUE(rig.has(t, u)) << "it stays until the calculation";
  rig.calculate();
  EXPECT_FALSE(rig.has(t, u));
  EXPECT_TRUE(rig.has(s, t));
  EXPECT_EQ(counter.added, 2);
  EXPECT_EQ(counter.removed, 1);
  rig.move(t, 5);
  rig.calculate();
  EXPECT_FALSE(rig.has(s, t));
  EXPECT_TRUE(rig.has(t, u));
  EXPECT_EQ(counter.added, 3);
  EXPECT_EQ(counter.removed, 2);
  rig.destroy(t);
  EXPECT_EQ(rig.pair_count(), 0);
  EXPECT_EQ(counter.removed, 3);
}

TEST(BulletAtOnce, APairThatWasRemovedOrRefusedComesBackAtOnce) {
  Rig rig(at_once);
  btBroadphaseProxy* s = rig.create_unit(0);
  btBroadphaseProxy* t = rig.create_unit(1);
  btBroadphaseProxy* u = rig.create_unit(0, 2, 2);
  rig.calculate();
  rig.cache().removeOverlappingPair(s, t, &rig.dispatcher());
  u->m_collisionFilterGroup = 1;
  u->m_collisionFilterMask = all_bits;
  rig.move(t, 0.5F);
  EXPECT_TRUE(rig.has(s, t));
  EXPECT_TRUE(rig.has(t, u));
  EXPECT_EQ(rig.pair_count(), 2) << "s and u did not move";
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 3);
  t->m_collisionFilterMask = 0;
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 1);
}

TEST(BulletAtOnce, AFilterThatChangesBeforeTheCalculationCounts) {
  Rig rig(at_once);
  btBroadphaseProxy* s = rig.create_unit(0);
  btBroadphaseProxy* t = rig.create_unit(5);
  rig.calculate();
  rig.move(t, 1);
  EXPECT_TRUE(rig.has(s, t));
  t->m_collisionFilterMask = 0;
  rig.calculate();
  EXPECT_FALSE(rig.has(s, t));
  rig.destroy(s);
  s = rig.create_unit(0);
  EXPECT_EQ(s->m_uniqueId, 0) << "ids are reused";
  t->m_collisionFilterMask = all_bits;
  rig.move(t, 0.5F);
  EXPECT_TRUE(rig.has(s, t));
  rig.destroy(t);
  rig.create_unit(7);
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 0);
}

TEST(BulletAtOnce, ADeferredRemovalCacheGetsNoPairTwice) {
  btSortedOverlappingPairCache cache;
  GhostRecorder counter;
  cache.setInternalGhostPairCallback(&counter);
  Rig rig(at_once, &cache);
  btBroadphaseProxy* s = rig.create_unit(0);
  btBroadphaseProxy* t = rig.create_unit(1);
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 1);
  EXPECT_EQ(counter.added, 1);
  rig.move(t, 5);
  rig.move(t, 0.5F);
  rig.move(s, -5);
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 0);
}

TEST(BulletAtOnce, WhatIsBegunEarlyEndsTheSameWay) {
  Rig rig(at_once);
  auto& broadphase = dynamic_cast<BulletBroadphase&>(rig.broadphase());
  btBroadphaseProxy* s = rig.create_unit(0);
  btBroadphaseProxy* t = rig.create_unit(5);
  broadphase.begin();
  rig.move(t, 1);
  EXPECT_TRUE(rig.has(s, t));
  btBroadphaseProxy* u = rig.create_unit(1);
  rig.move(s, -5);
  rig.calculate();
  EXPECT_EQ(rig.ids(), (std::vector<std::pair<int, int>>{{t->m_uniqueId, u->m_uniqueId}}));
}

/// A character is put into a wall between two steps and pushed out again: Bullet's controller looks for the
/// wall in the pair cache right after it has set the character's box.
TEST(BulletAtOnce, ACharacterRecoversFromAPenetrationWithoutACalculation) {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  BulletBroadphase broadphase;
  broadphase.set_pairs_at_once(true);
  btSequentialImpulseConstraintSolver solver;
  btDiscreteDynamicsWorld world(&dispatcher, &broadphase, &solver, &configuration);
  btGhostPairCallback ghosts;
  broadphase.getOverlappingPairCache()->setInternalGhostPairCallback(&ghosts);

  btBoxShape wall_shape(btVector3(1, 5, 5));
  btRigidBody wall(0, nullptr, &wall_shape);
  world.addRigidBody(&wall);
  btCapsuleShape capsule(btScalar(0.5), 1);
  btPairCachingGhostObject ghost;
  ghost.setCollisionShape(&capsule);
  ghost.setCollisionFlags(btCollisionObject::CF_CHARACTER_OBJECT);
  ghost.setWorldTransform(btTransform(btQuaternion::getIdentity(), btVector3(20, 0, 0)));
  world.addCollisionObject(&ghost, btBroadphaseProxy::CharacterFilter,
                           btBroadphaseProxy::StaticFilter | btBroadphaseProxy::DefaultFilter);
  btKinematicCharacterController character(&ghost, &capsule, btScalar(0.1), btVector3(0, 1, 0));
  character.setGravity(btVector3(0, 0, 0));
  world.stepSimulation(btScalar(1) / 60);
  EXPECT_EQ(ghost.getNumOverlappingObjects(), 0);

  character.warp(btVector3(btScalar(1.1), 0, 0));
  character.preStep(&world);
  character.playerStep(&world, btScalar(1) / 60);
  EXPECT_GT(ghost.getWorldTransform().getOrigin().x(), btScalar(1.2)) << "pushed towards its side";
  world.removeCollisionObject(&ghost);
  world.removeRigidBody(&wall);
}

}  // namespace
}  // namespace broadcl
