// Statements 20 to 24 of Bullet's contract: pair caches and ghosts.
#include <BulletCollision/CollisionDispatch/btGhostObject.h>
#include <btBulletCollisionCommon.h>

#include <memory>
#include <utility>
#include <vector>

#include "bullet_contract.hpp"

namespace broadcl::test {
namespace {

TEST_P(Contract, S20AUsersCacheIsUsedAndNeverDeleted) {
  bool dead = false;
  const auto cache = std::make_unique<MortalCache>(dead);
  {
    Rig rig(GetParam(), cache.get());
    EXPECT_EQ(rig.broadphase().getOverlappingPairCache(), cache.get());
    EXPECT_EQ(std::as_const(rig.broadphase()).getOverlappingPairCache(), cache.get());
    rig.create_unit(0);
    rig.create_unit(0.5F);
    rig.calculate();
    EXPECT_EQ(cache->getNumOverlappingPairs(), 1);
  }
  EXPECT_FALSE(dead);
}

TEST_P(Contract, S20TheNullCacheWorks) {
  btNullPairCache cache;
  Rig rig(GetParam(), &cache);
  std::vector<btBroadphaseProxy*> proxies(20);
  for (btBroadphaseProxy*& proxy : proxies) proxy = rig.create_unit(0);
  for (int frame = 0; frame < 5; ++frame) {
    rig.calculate();
    rig.move(proxies[3], static_cast<btScalar>(frame));
    EXPECT_EQ(rig.pair_count(), 0);
  }
  rig.destroy(proxies[7]);
  rig.calculate();
  EXPECT_EQ(rig.broadphase().getOverlappingPairCache(), &cache);
}

TEST_P(Contract, S21ADeferredRemovalCacheIsCleanedByTheCalculation) {
  fails("Simple", "it cleans no cache that it does not own");
  btSortedOverlappingPairCache cache;
  ASSERT_TRUE(cache.hasDeferredRemoval());
  Rig rig(GetParam(), &cache);
  btBroadphaseProxy* first = rig.create_unit(0);
  btBroadphaseProxy* second = rig.create_unit(0.5F);
  btBroadphaseProxy* mover = rig.create_unit(-0.5F);
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 3);
  int ends = 0;
  rig.find(first, mover)->m_algorithm = MortalAlgorithm::make(rig.dispatcher(), [&] { ++ends; });
  rig.move(mover, 77);
  for (int k = 0; k < 200 && rig.has(first, mover); ++k) rig.calculate();
  EXPECT_EQ(rig.pair_count(), 1);
  EXPECT_EQ(ends, 1);
  cache.addOverlappingPair(first, second);
  EXPECT_EQ(rig.pair_count(), 2) << "it accepts a pair twice";
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 1);
  EXPECT_TRUE(rig.has(first, second));
}

TEST_P(Contract, S21ADeferredRemovalCacheMayBeSharedByBroadPhases) {
  fails("Simple", "it cleans no cache that it does not own");
  btSortedOverlappingPairCache cache;
  Rig one(GetParam(), &cache);
  Rig other(GetParam(), &cache);
  one.create_unit(0);
  other.create_unit(0);
  btBroadphaseProxy* mover = one.create_unit(0.5F);
  btBroadphaseProxy* rover = other.create_unit(0.5F);
  const auto calculate = [&] {
    one.calculate();
    other.calculate();
  };
  calculate();
  EXPECT_EQ(cache.getNumOverlappingPairs(), 2);
  one.move(mover, 77);
  for (int k = 0; k < 200 && cache.getNumOverlappingPairs() > 1; ++k) calculate();
  EXPECT_EQ(cache.getNumOverlappingPairs(), 1) << "the other's pair of the same ids stays";
  other.move(rover, 77);
  for (int k = 0; k < 200 && cache.getNumOverlappingPairs() > 0; ++k) calculate();
  EXPECT_EQ(cache.getNumOverlappingPairs(), 0);
}

TEST(BulletCaches, NoPairIsTwiceInASharedDeferredRemovalCache) {
  btSortedOverlappingPairCache cache;
  Rig one(kinds.front(), &cache);
  Rig other(kinds.front(), &cache);
  btBroadphaseProxy* first = one.create_unit(0);
  btBroadphaseProxy* second = one.create_unit(0.5F);
  other.create_unit(0);
  other.create_unit(50);
  other.create_unit(0.5F);
  const auto calculate = [&] {
    one.calculate();
    other.calculate();
  };
  calculate();
  ASSERT_EQ(cache.getNumOverlappingPairs(), 2) << "(0, 1) of one, (0, 2) of the other";
  cache.addOverlappingPair(first, second);
  ASSERT_EQ(cache.getNumOverlappingPairs(), 3);
  calculate();
  EXPECT_EQ(cache.getNumOverlappingPairs(), 2);
}

TEST_P(Contract, S22CleaningAProxyFreesAlgorithmsAndKeepsPairs) {
  Rig rig(GetParam());
  btBroadphaseProxy* first = rig.create_unit(0);
  btBroadphaseProxy* second = rig.create_unit(0.5F);
  rig.calculate();
  int ends = 0;
  rig.find(first, second)->m_algorithm = MortalAlgorithm::make(rig.dispatcher(), [&] { ++ends; });
  rig.cache().cleanProxyFromPairs(first, &rig.dispatcher());
  EXPECT_EQ(ends, 1);
  rig.calculate();
  ASSERT_TRUE(rig.has(first, second));
  EXPECT_EQ(rig.find(first, second)->m_algorithm, nullptr);
  rig.move(second, 77);
  rig.calculate_until_parted(first, second);
  EXPECT_EQ(ends, 1);
}

TEST_P(Contract, S23GhostsAreToldOfEachPairOnce) {
  Rig rig(GetParam());
  GhostRecorder ghosts;
  rig.cache().setInternalGhostPairCallback(&ghosts);
  Random random(6);
  for (int k = 0; k < 40; ++k) rig.create(random.point(9), {10, 10, 10});
  for (int frame = 0; frame < 30; ++frame) {
    for (int call = 0; call < 10; ++call) {
      const btVector3 lower = random.point(9);
      rig.move(rig.proxies()[random.below(static_cast<unsigned>(rig.proxies().size()))], lower,
               lower + btVector3(1, 1, 1));
    }
    if (frame % 5 == 4) rig.destroy(rig.proxies()[random.below(20)]);
    rig.calculate();
    ASSERT_EQ(ghosts.added - ghosts.removed, rig.pair_count()) << "frame " << frame;
  }
  EXPECT_GT(ghosts.removed, 50);
  EXPECT_EQ(ghosts.forbidden, 0);
  rig.cache().setInternalGhostPairCallback(nullptr);
}

TEST_P(Contract, S23AGhostObjectSeesWhoOverlapsIt) {
  const std::unique_ptr<btBroadphaseInterface> broadphase = GetParam().make(nullptr);
  btGhostPairCallback ghosts;
  broadphase->getOverlappingPairCache()->setInternalGhostPairCallback(&ghosts);
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btCollisionWorld world(&dispatcher, broadphase.get(), &configuration);
  btSphereShape shape(1);
  btPairCachingGhostObject ghost;
  btCollisionObject visitor;
  for (btCollisionObject* object : {static_cast<btCollisionObject*>(&ghost), &visitor}) {
    object->setCollisionShape(&shape);
    world.addCollisionObject(object);
  }
  const auto go_to = [&](btScalar x) {
    visitor.getWorldTransform().setOrigin({x, 0, 0});
    world.performDiscreteCollisionDetection();
  };
  go_to(50);
  for (int k = 0; k < 200 && ghost.getNumOverlappingObjects() > 0; ++k) go_to(50);
  EXPECT_EQ(ghost.getNumOverlappingObjects(), 0);
  go_to(1);
  ASSERT_EQ(ghost.getNumOverlappingObjects(), 1);
  EXPECT_EQ(ghost.getOverlappingObject(0), &visitor);
  EXPECT_EQ(ghost.getOverlappingPairCache()->getNumOverlappingPairs(), 1);
  world.removeCollisionObject(&visitor);
  EXPECT_EQ(ghost.getNumOverlappingObjects(), 0);
  EXPECT_EQ(ghost.getOverlappingPairCache()->getNumOverlappingPairs(), 0);
  world.removeCollisionObject(&ghost);
}

TEST_P(Contract, S24TheHashOfTheCacheStaysSound) {
  Rig rig(GetParam());
  Random random(7);
  for (int k = 0; k < 60; ++k) rig.create(random.point(9), {10, 10, 10});
  for (int frame = 0; frame < 20; ++frame) {
    for (int call = 0; call < 20; ++call) {
      const btVector3 lower = random.point(9);
      rig.move(rig.proxies()[random.below(static_cast<unsigned>(rig.proxies().size()))], lower,
               lower + btVector3(2, 2, 2));
    }
    if (frame % 4 == 3) rig.destroy(rig.proxies()[random.below(20)]);
    rig.calculate();
    for (int k = 0; k < rig.pair_count(); ++k) {
      btBroadphasePair* pair = &rig.cache().getOverlappingPairArray()[k];
      ASSERT_EQ(rig.cache().findPair(pair->m_pProxy0, pair->m_pProxy1), pair);
    }
  }
}

}  // namespace
}  // namespace broadcl::test
