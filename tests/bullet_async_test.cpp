#include <broadcl/bullet.hpp>

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "runs.hpp"
#include "scenes/world.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

using Ids = std::vector<std::pair<int, int>>;

/// The pairs of the cache, in its own order.
Ids cached(btBroadphaseInterface& broadphase) {
  Ids ids;
  const btBroadphasePairArray& pairs = broadphase.getOverlappingPairCache()->getOverlappingPairArray();
  for (int k = 0; k < pairs.size(); ++k) {
    ids.emplace_back(pairs[k].m_pProxy0->m_uniqueId, pairs[k].m_pProxy1->m_uniqueId);
  }
  return ids;
}

/// Calls on proxies that depend only on the seed.
class Churn {
 public:
  Churn(btBroadphaseInterface& broadphase, unsigned seed) : broadphase_(broadphase), random_(seed) {}

  void run(int calls) {
    for (int k = 0; k < calls; ++k) {
      const std::size_t slot = random_() % proxies_.size();
      const unsigned what = random_() % 8;
      btBroadphaseProxy*& proxy = proxies_[slot];
      const float x = coordinate();
      const float y = coordinate();
      const btVector3 lower(x, y, coordinate());
      const btVector3 upper = lower + btVector3(2, 2, 2);
      if (proxy == nullptr) {
        proxy = broadphase_.createProxy(lower, upper, 0, nullptr, 1 << what % 2, -1, nullptr);
      } else if (what == 0) {
        broadphase_.destroyProxy(proxy, nullptr);
        proxy = nullptr;
      } else if (what == 1) {
        proxy->m_collisionFilterMask ^= 1;
      } else {
        broadphase_.setAabb(proxy, lower, upper, nullptr);
      }
    }
  }

 private:
  float coordinate() { return static_cast<float>(random_() % 80) / 10; }

  btBroadphaseInterface& broadphase_;
  std::mt19937 random_;
  std::array<btBroadphaseProxy*, 60> proxies_{};
};

TEST(BulletAsync, GivesWhatItGivesWithoutWhateverHappensMeanwhile) {
  BulletBroadphase begun;
  BulletBroadphase plain;
  Churn begun_churn(begun, 5);
  Churn plain_churn(plain, 5);
  std::size_t most = 0;
  for (int frame = 0; frame < 200; ++frame) {
    const int before = frame * 7 % 20;
    const int meanwhile = frame * 5 % 30;
    begun_churn.run(before);
    begun.begin();
    if (frame % 10 == 0) begun.begin();
    begun_churn.run(meanwhile);
    begun.calculateOverlappingPairs(nullptr);
    plain_churn.run(before + meanwhile);
    plain.calculateOverlappingPairs(nullptr);
    ASSERT_EQ(cached(begun), cached(plain)) << "frame " << frame;
    most = std::max(most, cached(plain).size());
  }
  EXPECT_GT(most, 50U);
}

TEST(BulletAsync, NothingOfADestroyedProxyComesBack) {
  BulletBroadphase broadphase;
  const auto create = [&](float x) {
    return broadphase.createProxy({x, 0, 0}, {x + 1, 1, 1}, 0, nullptr, 1, -1, nullptr);
  };
  btBroadphaseProxy* old_pair = create(0);
  create(0);
  broadphase.calculateOverlappingPairs(nullptr);
  btBroadphaseProxy* new_pair = create(0);
  broadphase.begin();
  broadphase.destroyProxy(old_pair, nullptr);
  EXPECT_TRUE(cached(broadphase).empty()) << "its pairs are removed at once";
  broadphase.destroyProxy(new_pair, nullptr);
  EXPECT_EQ(create(5)->m_uniqueId, 0) << "the id is reused";
  broadphase.calculateOverlappingPairs(nullptr);
  EXPECT_TRUE(cached(broadphase).empty());
}

class EachScenarioAsync : public testing::TestWithParam<std::string> {};

NOT_IN(sanitizers, "takes long");
TEST_P(EachScenarioAsync, GoesTheSameWay) {
  const scenes::Scenario::Config config{.name = GetParam(), .objects = 300};
  BulletBroadphase begun;
  BulletBroadphase plain;
  scenes::World begun_world(config, begun);
  scenes::World plain_world(config, plain);
  for (int frame = 0; frame < 300; ++frame) {
    begun_world.step();
    plain_world.step();
    begun.begin();
    for (std::size_t k = 0; k < config.objects; ++k) {
      ASSERT_EQ(begun_world.position(k), plain_world.position(k)) << "object " << k << ", frame " << frame;
    }
    ASSERT_EQ(cached(begun), cached(plain)) << "frame " << frame;
  }
  EXPECT_GT(plain_world.pair_count(), 50U);
}

std::vector<std::string> scenario_names() {
  std::vector<std::string> names;
  for (const scenes::ScenarioInfo& row : scenes::Scenario::list()) names.emplace_back(row.name);
  return names;
}

INSTANTIATE_TEST_SUITE_P(World, EachScenarioAsync, testing::ValuesIn(scenario_names()),
                         test::named_by_parameter);

}  // namespace
}  // namespace broadcl
