#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

#include <array>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include <btBulletDynamicsCommon.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "runs.hpp"

namespace broadcl {
namespace {

SUITE_ALSO_IN(Bullet, gpu_profile | rusticl);

constexpr int all_bits = -1;
using IdPairs = std::set<std::pair<int, int>>;

/// A broad phase with Bullet's dispatcher around it.
class Bullet : public ::testing::Test {
 protected:
  btBroadphaseProxy* create(const btVector3& lower, const btVector3& upper, int group = 1,
                            int mask = all_bits) {
    return broadphase_.createProxy(lower, upper, BOX_SHAPE_PROXYTYPE, nullptr, group, mask, &dispatcher_);
  }
  btBroadphaseProxy* create_unit(btScalar x, int group = 1, int mask = all_bits) {
    return create({x, 0, 0}, {x + 1, 1, 1}, group, mask);
  }
  void calculate() { broadphase_.calculateOverlappingPairs(&dispatcher_); }
  IdPairs pairs() {
    IdPairs result;
    const btBroadphasePairArray& array = broadphase_.getOverlappingPairCache()->getOverlappingPairArray();
    for (int k = 0; k < array.size(); ++k) {
      EXPECT_LT(array[k].m_pProxy0->m_uniqueId, array[k].m_pProxy1->m_uniqueId);
      EXPECT_TRUE(result.emplace(array[k].m_pProxy0->m_uniqueId, array[k].m_pProxy1->m_uniqueId).second);
    }
    return result;
  }

  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  BulletBroadphase broadphase_;
};

TEST_F(Bullet, FiltersWrittenInPlaceTakeEffectInTheNextCalculation) {
  btBroadphaseProxy* first = create_unit(0);
  create_unit(0);
  btBroadphaseProxy* outsider = create_unit(0, 2, 2);
  calculate();
  EXPECT_EQ(pairs(), (IdPairs{{0, 1}}));
  outsider->m_collisionFilterGroup = 1;
  outsider->m_collisionFilterMask = all_bits;
  first->m_collisionFilterMask = 4;
  calculate();
  EXPECT_EQ(pairs(), (IdPairs{{1, 2}}));
  first->m_collisionFilterMask = 1;
  calculate();
  EXPECT_EQ(pairs().size(), 3U);
}

TEST_F(Bullet, FiltersAreLookedAtWhereverAProxyLies) {
  std::vector<btBroadphaseProxy*> proxies;
  proxies.reserve(600);
  for (int k = 0; k < 600; k += 2) {
    for (int twin = 0; twin < 2; ++twin) proxies.push_back(create_unit(static_cast<btScalar>(k)));
  }
  calculate();
  std::size_t left = pairs().size();
  for (const std::size_t k : {0U, 63U, 64U, 190U, 193U, 254U, 256U, 511U, 512U, 599U}) {
    proxies[k]->m_collisionFilterMask = 0;
    calculate();
    EXPECT_EQ(pairs().size(), --left) << k;
  }
}

TEST_F(Bullet, ANewProxyPairsWithThoseThatHaveFilters) {
  create_unit(0, 2, all_bits);
  calculate();
  create_unit(0);
  calculate();
  EXPECT_EQ(pairs(), (IdPairs{{0, 1}}));
}

TEST_F(Bullet, NothingIsAskedOfTheDeviceWhereNothingHasChanged) {
  for (int k = 0; k < 10; ++k) create_unit(0);
  calculate();
  btBroadphaseProxy* proxy = create_unit(0);
  calculate();
  EXPECT_EQ(pairs().size(), 55U);
  broadphase_.setAabb(proxy, proxy->m_aabbMin, proxy->m_aabbMax, &dispatcher_);
  calculate();
  EXPECT_TRUE(broadphase_.broad_phase().profile().empty());
  EXPECT_EQ(pairs().size(), 55U);
}

/// Lets pairs in by a rule that can change, and counts how often it is asked.
class Gate final : public btOverlapFilterCallback {
 public:
  bool needBroadphaseCollision(btBroadphaseProxy* /*s*/, btBroadphaseProxy* /*t*/) const override {
    ++asked;
    return open;
  }
  bool open = true;
  mutable int asked = 0;
};

TEST_F(Bullet, ACallbackMayAcceptWhatTheMasksReject) {
  create_unit(0, 1, 2);
  create_unit(0, 1, 2);
  calculate();
  EXPECT_TRUE(pairs().empty());
  Gate gate;
  broadphase_.getOverlappingPairCache()->setOverlapFilterCallback(&gate);
  create_unit(0, 0, 0);
  calculate();
  EXPECT_EQ(pairs().size(), 3U);
  broadphase_.getOverlappingPairCache()->setOverlapFilterCallback(nullptr);
  calculate();
  EXPECT_TRUE(pairs().empty()) << "the masks apply again";
}

TEST_F(Bullet, AnotherCallbackDecidesEveryPairAnew) {
  std::array<Gate, 2> gates;
  gates[0].open = false;
  btOverlappingPairCache& cache = *broadphase_.getOverlappingPairCache();
  cache.setOverlapFilterCallback(&gates[0]);
  for (int k = 0; k < 4; ++k) create_unit(0);
  calculate();
  EXPECT_TRUE(pairs().empty());
  cache.setOverlapFilterCallback(&gates[1]);
  calculate();
  EXPECT_EQ(pairs().size(), 6U);
  cache.setOverlapFilterCallback(&gates[0]);
  calculate();
  EXPECT_TRUE(pairs().empty());
  cache.setOverlapFilterCallback(nullptr);
  calculate();
  EXPECT_EQ(pairs().size(), 6U);
}

TEST_F(Bullet, ARefusedPairIsOfferedAgainOnceAnObjectOfItChanges) {
  Gate gate;
  gate.open = false;
  broadphase_.getOverlappingPairCache()->setOverlapFilterCallback(&gate);
  btBroadphaseProxy* mover = create_unit(0);
  btBroadphaseProxy* other = create_unit(0);
  create_unit(0.5);
  calculate();
  EXPECT_EQ(gate.asked, 3);
  calculate();
  EXPECT_EQ(gate.asked, 3) << "nothing has changed";
  broadphase_.setAabb(mover, {0.1F, 0, 0}, {1.1F, 1, 1}, &dispatcher_);
  calculate();
  EXPECT_EQ(gate.asked, 5);
  EXPECT_TRUE(pairs().empty());
  gate.open = true;
  calculate();
  EXPECT_TRUE(pairs().empty());
  other->m_collisionFilterGroup = 2;
  calculate();
  EXPECT_EQ(pairs(), (IdPairs{{0, 1}, {1, 2}}));
  broadphase_.setAabb(mover, {0, 0, 0}, {1, 1, 1}, &dispatcher_);
  calculate();
  EXPECT_EQ(pairs().size(), 3U);
}

TEST_F(Bullet, ARefusedPairThatPartsIsForgotten) {
  Gate gate;
  gate.open = false;
  broadphase_.getOverlappingPairCache()->setOverlapFilterCallback(&gate);
  btBroadphaseProxy* mover = create_unit(0);
  create_unit(0);
  btBroadphaseProxy* doomed = create_unit(0);
  calculate();
  broadphase_.setAabb(mover, {5, 0, 0}, {6, 1, 1}, &dispatcher_);
  broadphase_.destroyProxy(doomed, &dispatcher_);
  gate.open = true;
  calculate();
  EXPECT_TRUE(pairs().empty());
  EXPECT_EQ(gate.asked, 3);
}

/// One pair is removed from the cache and another added between two calculations, so their number stays the
/// same.
TEST_F(Bullet, APairThatTheUserPutInGoesWhenItParts) {
  btBroadphaseProxy* s = create_unit(0);
  btBroadphaseProxy* t = create_unit(0);
  btBroadphaseProxy* u = create_unit(10);
  btBroadphaseProxy* v = create_unit(10);
  btOverlappingPairCache& cache = *broadphase_.getOverlappingPairCache();
  calculate();
  cache.removeOverlappingPair(s, t, &dispatcher_);
  calculate();
  cache.removeOverlappingPair(u, v, &dispatcher_);
  cache.addOverlappingPair(s, t);
  calculate();
  EXPECT_EQ(pairs(), (IdPairs{{0, 1}}));
  broadphase_.setAabb(t, {5, 0, 0}, {6, 1, 1}, &dispatcher_);
  calculate();
  EXPECT_TRUE(pairs().empty());
}

/// A user's cache that admits pairs by a rule of its own.
class OddCache final : public btHashedOverlappingPairCache {
 public:
  btBroadphasePair* addOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t) override {
    if ((s->m_uniqueId + t->m_uniqueId) % 2 == 0) return nullptr;
    btOverlapFilterCallback* mine = getOverlapFilterCallback();
    Gate all;
    setOverlapFilterCallback(&all);
    btBroadphasePair* pair = btHashedOverlappingPairCache::addOverlappingPair(s, t);
    setOverlapFilterCallback(mine);
    return pair;
  }
};

/// A user's cache that must hold every pair that it is asked to remove.
class StrictCache final : public btHashedOverlappingPairCache {
 public:
  void* removeOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t, btDispatcher* dispatcher) override {
    EXPECT_NE(findPair(s, t), nullptr);
    ++removals;
    return btHashedOverlappingPairCache::removeOverlappingPair(s, t, dispatcher);
  }
  int removals = 0;
};

TEST(BulletCache, IsAskedToRemoveOnlyWhatItHolds) {
  StrictCache cache;
  BulletBroadphase broadphase({}, &cache);
  const auto create = [&] {
    return broadphase.createProxy({0, 0, 0}, {1, 1, 1}, 0, nullptr, 1, all_bits, nullptr);
  };
  btBroadphaseProxy* first = create();
  btBroadphaseProxy* second = create();
  broadphase.calculateOverlappingPairs(nullptr);
  broadphase.destroyProxy(first, nullptr);
  EXPECT_EQ(cache.removals, 1);
  EXPECT_EQ(create()->m_uniqueId, 0);
  broadphase.calculateOverlappingPairs(nullptr);
  EXPECT_EQ(cache.removals, 1);
  broadphase.setAabb(second, {5, 0, 0}, {6, 1, 1}, nullptr);
  broadphase.calculateOverlappingPairs(nullptr);
  EXPECT_EQ(cache.removals, 2);
}

TEST(BulletCache, AUsersClassIsOfferedEveryOverlappingPair) {
  OddCache cache;
  BulletBroadphase broadphase({}, &cache);
  for (int k = 0; k < 4; ++k) broadphase.createProxy({0, 0, 0}, {1, 1, 1}, 0, nullptr, 0, 0, nullptr);
  broadphase.calculateOverlappingPairs(nullptr);
  EXPECT_EQ(cache.getNumOverlappingPairs(), 4);
}

TEST_F(Bullet, ANaNBoundIsReportedOnceEachTimeItTurnsUp) {
  const btScalar nan_value = std::numeric_limits<btScalar>::quiet_NaN();
  std::vector<std::string> errors;
  broadphase_.set_error_handler([&](const std::string& error) { errors.push_back(error); });
  create_unit(0);
  btBroadphaseProxy* invalid = create({nan_value, 0, 0}, {1, 1, 1});
  EXPECT_THAT(errors, testing::ElementsAre(testing::HasSubstr("proxy 1 has a NaN bound")));
  broadphase_.setAabb(invalid, {0, nan_value, 0}, {1, 1, 1}, &dispatcher_);
  calculate();
  EXPECT_EQ(errors.size(), 1U);
  broadphase_.setAabb(invalid, {0, 0, 0}, {1, 1, 1}, &dispatcher_);
  calculate();
  EXPECT_EQ(pairs().size(), 1U) << "the broad phase still works";
  broadphase_.setAabb(invalid, {0, 0, 0}, {1, 1, nan_value}, &dispatcher_);
  EXPECT_EQ(errors.size(), 2U);
  broadphase_.setAabb(invalid, {2, 2, 2}, {1, 1, 1}, &dispatcher_);
  EXPECT_EQ(errors.size(), 2U) << "an inverted box is no error: it overlaps nothing";
}

}  // namespace
}  // namespace broadcl
