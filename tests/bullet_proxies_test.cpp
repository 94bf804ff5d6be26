// Statements 1 to 6 of Bullet's contract: proxies.
#include <array>
#include <cstddef>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "bullet_contract.hpp"
#include "runs.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

INSTANTIATE_TEST_SUITE_P(Bullet, Contract, testing::ValuesIn(kinds), named_by_parameter);

TEST_P(Contract, S01AProxyHasWhatItWasGiven) {
  fails("Sweep", "the bounds are garbage until the first setAabb");
  Rig rig(GetParam());
  int client = 0;
  const int high_bit = std::numeric_limits<int>::min();
  const btBroadphaseProxy* proxy = rig.create({0.5F, 1, 2}, {3, 4, 5}, 1 << 20, high_bit, &client);
  ASSERT_NE(proxy, nullptr);
  EXPECT_EQ(proxy->m_clientObject, &client);
  EXPECT_EQ(proxy->m_collisionFilterGroup, 1 << 20);
  EXPECT_EQ(proxy->m_collisionFilterMask, high_bit);
  EXPECT_EQ(proxy->m_aabbMin, btVector3(0.5F, 1, 2));
  EXPECT_EQ(proxy->m_aabbMax, btVector3(3, 4, 5));
  EXPECT_GE(proxy->m_uniqueId, 0);
}

TEST_P(Contract, S02IdsAreUniqueAndFollowFromTheCalls) {
  const auto play = [&](bool noise) {
    std::vector<std::unique_ptr<std::vector<char>>> heap;
    Rig rig(GetParam());
    Random random(1);
    std::vector<int> ids;
    std::map<const btBroadphaseProxy*, int> alive;
    for (std::size_t k = 0; k < 500; ++k) {
      if (noise) heap.push_back(std::make_unique<std::vector<char>>(1 + 7 * (k % 50)));
      if (!rig.proxies().empty() && random.below(3) == 0) {
        btBroadphaseProxy* proxy = rig.proxies()[random.below(static_cast<unsigned>(rig.proxies().size()))];
        alive.erase(proxy);
        rig.destroy(proxy);
      } else {
        const btBroadphaseProxy* proxy = rig.create_unit(static_cast<btScalar>(k));
        alive[proxy] = proxy->m_uniqueId;
        ids.push_back(proxy->m_uniqueId);
      }
      if (k % 20 == 0) rig.calculate();
    }
    std::set<int> unique;
    for (const auto& [proxy, id] : alive) {
      EXPECT_EQ(proxy->m_uniqueId, id);
      EXPECT_GE(id, 0);
      EXPECT_TRUE(unique.insert(id).second);
    }
    return ids;
  };
  const std::vector<int> ids = play(false);
  EXPECT_EQ(play(true), ids);
  EXPECT_GT(std::set<int>(ids.begin(), ids.end()).size(), 100U);
}

TEST_P(Contract, S03ProxiesNeverMove) {
  Rig rig(GetParam());
  btBroadphaseProxy* first = rig.create_unit(7);
  rig.move(first, 8);
  const int id = first->m_uniqueId;
  for (int k = 0; k < 3000; ++k) rig.create_unit(static_cast<btScalar>(k % 900));
  rig.calculate();
  btVector3 lower;
  btVector3 upper;
  rig.broadphase().getAabb(first, lower, upper);
  EXPECT_EQ(lower, btVector3(8, 0, 0));
  EXPECT_EQ(first->m_uniqueId, id);
  std::set<const btBroadphaseProxy*> in_cache;
  for (int k = 0; k < rig.pair_count(); ++k) {
    in_cache.insert(rig.cache().getOverlappingPairArray()[k].m_pProxy0);
    in_cache.insert(rig.cache().getOverlappingPairArray()[k].m_pProxy1);
  }
  EXPECT_TRUE(in_cache.contains(first));
}

TEST_P(Contract, S04SetAabbIsImmediateAndExact) {
  Rig rig(GetParam());
  btBroadphaseProxy* proxy = rig.create_unit(0);
  for (const btScalar x : {btScalar(0.1), btScalar(3.3), btScalar(-77.7), btScalar(0)}) {
    const btVector3 lower(x, x / 3, -x / 7);
    const btVector3 upper = lower + btVector3(btScalar(0.1), btScalar(0.2), btScalar(0.3));
    rig.move(proxy, lower, upper);
    btVector3 l;
    btVector3 u;
    rig.broadphase().getAabb(proxy, l, u);
    EXPECT_EQ(l, lower);
    EXPECT_EQ(u, upper);
    EXPECT_EQ(proxy->m_aabbMin, lower);
    EXPECT_EQ(proxy->m_aabbMax, upper);
  }
  const btBroadphaseProxy* there = rig.create_unit(50);
  rig.move(proxy, 20);
  rig.move(proxy, 50.5F);
  rig.calculate();
  EXPECT_TRUE(rig.has(proxy, there)) << "the last of several wins";
}

TEST_P(Contract, S05DestroyingEndsAllOfAProxy) {
  Rig rig(GetParam());
  GhostRecorder ghosts;
  rig.cache().setInternalGhostPairCallback(&ghosts);
  std::array<int, 3> clients{};
  btBroadphaseProxy* first = rig.create_unit(0, 1, all_bits, &clients[0]);
  btBroadphaseProxy* second = rig.create_unit(0.5F, 1, all_bits, &clients[1]);
  rig.create_unit(0.7F, 1, all_bits, &clients[2]);
  rig.calculate();
  ASSERT_EQ(rig.pair_count(), 3);
  int ends = 0;
  rig.find(first, second)->m_algorithm = MortalAlgorithm::make(rig.dispatcher(), [&] { ++ends; });
  ghosts.clients.clear();
  rig.destroy(second);
  EXPECT_EQ(rig.pair_count(), 1);
  EXPECT_EQ(ends, 1);
  EXPECT_EQ(ghosts.removed, 2);
  EXPECT_EQ(ghosts.clients, (std::set<const void*>{&clients[0], &clients[1], &clients[2]}));
  rig.create_unit(300);
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 1) << "a reused slot inherits nothing";
  rig.cache().setInternalGhostPairCallback(nullptr);
}

TEST_P(Contract, S05DestroyingEndsAllOfAProxyInADeferredRemovalCacheToo) {
  fails("Sweep", "pairs stay in such a cache, and the next proxy of the slot inherits their algorithms");
  btSortedOverlappingPairCache cache;
  Rig rig(GetParam(), &cache);
  btBroadphaseProxy* first = rig.create_unit(0);
  btBroadphaseProxy* second = rig.create_unit(0.5F);
  rig.calculate();
  ASSERT_TRUE(rig.has(first, second));
  int ends = 0;
  rig.find(first, second)->m_algorithm = MortalAlgorithm::make(rig.dispatcher(), [&] { ++ends; });
  rig.destroy(second);
  EXPECT_EQ(ends, 1);
  EXPECT_EQ(rig.pair_count(), 0);
  rig.create_unit(300);
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 0);
}

TEST_P(Contract, S06DispatcherAndClientMayBeNull) {
  fails("Simple", "it takes a proxy without a client for a free slot");
  Rig rig(GetParam());
  btBroadphaseInterface& broadphase = rig.broadphase();
  const auto create = [&] {
    return broadphase.createProxy({0, 0, 0}, {1, 1, 1}, BOX_SHAPE_PROXYTYPE, nullptr, 1, all_bits, nullptr);
  };
  btBroadphaseProxy* first = create();
  btBroadphaseProxy* second = create();
  broadphase.calculateOverlappingPairs(nullptr);
  EXPECT_EQ(rig.pair_count(), 1);
  broadphase.setAabb(first, {5, 0, 0}, {6, 1, 1}, nullptr);
  broadphase.setAabb(first, {0.5F, 0, 0}, {1, 1, 1}, nullptr);
  broadphase.calculateOverlappingPairs(nullptr);
  EXPECT_EQ(rig.pair_count(), 1);
  broadphase.resetPool(nullptr);
  broadphase.destroyProxy(first, nullptr);
  EXPECT_EQ(rig.pair_count(), 0);
  broadphase.destroyProxy(second, nullptr);
}

NOT_IN(sanitizers, "takes long");
TEST_P(Contract, S06ThereIsNoCapacity) {
  if (unfit("Sweep", "crashes when it is full") || unfit("Simple", "stops the program when it is full"))
    return;
  Rig rig(GetParam());
  for (std::size_t k = 0; k < 2 * capacity; ++k) rig.create_unit(btScalar(1.5) * static_cast<btScalar>(k));
  const btBroadphaseProxy* last = rig.create_unit(3.2F);
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 1);
  EXPECT_TRUE(rig.has(rig.proxies()[2], last));
}

}  // namespace
}  // namespace broadcl::test
