// The adapter's own pair cache compared with Bullet's: both get the same calls, and after each call they must
// have the same pairs in the same order, made the same calls to ghosts and freed the same algorithms.
#include "bullet/pair_cache.hpp"

#include <BulletCollision/CollisionDispatch/btCollisionDispatcher.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "bullet_rig.hpp"
#include "mortal_algorithm.hpp"
#include "scenes/random.hpp"

namespace broadcl {
namespace {

using scenes::Random;

struct Ghosts final : btOverlappingPairCallback {
  btBroadphasePair* addOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t) override {
    calls.push_back({'+', s, t});
    return nullptr;
  }
  void* removeOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t, btDispatcher* /*d*/) override {
    calls.push_back({'-', s, t});
    return nullptr;
  }
  void removeOverlappingPairsContainingProxy(btBroadphaseProxy* s, btDispatcher* /*d*/) override {
    calls.push_back({'x', s, nullptr});
  }
  struct Call {
    char what;
    const void* s;
    const void* t;
    bool operator==(const Call&) const = default;
  };
  std::vector<Call> calls;
};

/// A cache, and its effects on other objects.
template <class Cache>
struct Side {
  Side() { cache.setInternalGhostPairCallback(&ghosts); }

  [[nodiscard]] std::vector<std::array<const void*, 2>> pairs() const {
    std::vector<std::array<const void*, 2>> result;
    for (int k = 0; k < cache.getNumOverlappingPairs(); ++k) {
      const btBroadphasePair& pair = cache.getOverlappingPairArray()[k];
      result.push_back({pair.m_pProxy0, pair.m_pProxy1});
    }
    return result;
  }
  void start_algorithm(int index, int number) {
    btBroadphasePair& pair = cache.getOverlappingPairArray()[index];
    if (pair.m_algorithm != nullptr) return;
    pair.m_algorithm = test::MortalAlgorithm::make(dispatcher, [this, number] { ended.push_back(number); });
  }

  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher{&configuration};
  Ghosts ghosts;
  std::vector<int> ended;
  Cache hashed;
  btOverlappingPairCache& cache = hashed;
};

/// Removes the pairs whose sum of ids has a given remainder.
struct RemoveSome final : btOverlapCallback {
  explicit RemoveSome(unsigned wanted) : remainder(wanted) {}
  bool processOverlap(btBroadphasePair& pair) override {
    const auto a = static_cast<unsigned>(pair.m_pProxy0->m_uniqueId);
    const auto b = static_cast<unsigned>(pair.m_pProxy1->m_uniqueId);
    return (a + b) % 5 == remainder;
  }
  unsigned remainder;
};

/// Records the pairs of one cache, then those of the other.
struct Record final : btOverlapCallback {
  bool processOverlap(btBroadphasePair& pair) override {
    pairs.back().push_back({pair.m_pProxy0, pair.m_pProxy1});
    return false;
  }
  std::vector<std::vector<std::array<const void*, 2>>> pairs{1};
};

/// Both caches, and proxies whose pairs go to both.
class Twins {
 public:
  explicit Twins(std::span<const int> ids) {
    for (const int id : ids) proxies_.push_back(make(id));
  }

  template <class Function>
  void both(Function&& function) {
    function(ours_);
    function(bullets_);
  }
  void play(unsigned calls, Random& random) {
    const auto count = static_cast<std::uint32_t>(proxies_.size());
    for (unsigned call = 0; call < calls; ++call) {
      const std::uint32_t k = random.index(count);
      btBroadphaseProxy* proxy = proxies_[k].get();
      btBroadphaseProxy* other = proxies_[random.index(count)].get();
      const std::uint32_t what = random.index(100);
      if (what < 60) {
        both([&](auto& side) { side.cache.addOverlappingPair(proxy, other); });
      } else if (what < 75) {
        both([&](auto& side) { side.cache.removeOverlappingPair(proxy, other, &side.dispatcher); });
      } else if (what < 85) {
        start_algorithm(random, static_cast<int>(call));
      } else if (what < 90) {
        both([&](auto& side) { side.cache.cleanProxyFromPairs(proxy, &side.dispatcher); });
      } else if (what < 97) {
        both([&](auto& side) { side.cache.removeOverlappingPairsContainingProxy(proxy, &side.dispatcher); });
        // Most of these proxies are destroyed, and a new one gets the id.
        if (what < 95) proxies_[k] = make(proxy->m_uniqueId);
      } else if (what < 99) {
        RemoveSome some(random.index(5));
        if (what == 97) {
          both([&](auto& side) { side.cache.processAllOverlappingPairs(&some, &side.dispatcher); });
        } else {
          both([&](auto& side) { side.cache.processAllOverlappingPairs(&some, &side.dispatcher, {}); });
        }
        process_all(random);
      } else {
        both([&](auto& side) { side.cache.sortOverlappingPairs(&side.dispatcher); });
      }
      ASSERT_EQ(ours_.pairs(), bullets_.pairs()) << "call " << call << ", " << what;
      ASSERT_EQ(ours_.ghosts.calls, bullets_.ghosts.calls) << "call " << call << ", " << what;
      ASSERT_EQ(ours_.ended, bullets_.ended) << "call " << call << ", " << what;
      most_ = std::max(most_, ours_.pairs().size());
      ours_.ghosts.calls.clear();
      bullets_.ghosts.calls.clear();
    }
  }
  [[nodiscard]] std::size_t most_pairs() const { return most_; }
  [[nodiscard]] std::size_t algorithms_ended() const { return ours_.ended.size(); }
  ~Twins() {
    for (const auto& proxy : proxies_) {
      both([&](auto& side) {
        side.cache.removeOverlappingPairsContainingProxy(proxy.get(), &side.dispatcher);
      });
    }
    EXPECT_EQ(ours_.cache.getNumOverlappingPairs(), 0);
  }
  Twins(const Twins&) = delete;
  Twins& operator=(const Twins&) = delete;
  Twins(Twins&&) = delete;
  Twins& operator=(Twins&&) = delete;

 private:
  static std::unique_ptr<btBroadphaseProxy> make(int id) {
    auto proxy = std::make_unique<btBroadphaseProxy>();
    proxy->m_uniqueId = id;
    proxy->m_collisionFilterGroup = 1;
    proxy->m_collisionFilterMask = id % 7 == 6 ? 0 : 1;  // some are refused
    return proxy;
  }
  void start_algorithm(Random& random, int number) {
    const int n = ours_.cache.getNumOverlappingPairs();
    if (n == 0) return;
    const auto index = static_cast<int>(random.index(static_cast<std::uint32_t>(n)));
    both([&](auto& side) { side.start_algorithm(index, number); });
  }

  /// As a dispatcher does.
  void process_all(Random& random) {
    btDispatcherInfo info;
    info.m_deterministicOverlappingPairs = random.index(2) == 0;
    Record record;
    both([&](auto& side) {
      side.cache.processAllOverlappingPairs(&record, &side.dispatcher, info);
      record.pairs.emplace_back();
    });
    EXPECT_EQ(record.pairs[0], record.pairs[1]);
  }

  std::vector<std::unique_ptr<btBroadphaseProxy>> proxies_;
  Side<PairCache> ours_;
  Side<btHashedOverlappingPairCache> bullets_;
  std::size_t most_ = 0;
};

std::vector<int> dense_ids(std::size_t count) {
  std::vector<int> ids(count);
  std::iota(ids.begin(), ids.end(), 0);
  return ids;
}

TEST(BulletPairCache, HoldsWhatBulletsOwnHolds) {
  for (const std::size_t count : {2U, 5U, 40U, 150U}) {
    Random random(count);
    Twins twins(dense_ids(count));
    ASSERT_NO_FATAL_FAILURE(twins.play(5000, random)) << count << " proxies";
    EXPECT_GT(twins.algorithms_ended(), count > 2 ? 100U : 10U);
    EXPECT_GT(twins.most_pairs(), count > 40 ? 50U : 0U);
  }
}

TEST(BulletPairCache, TakesProxiesOfAnyIdAndIdsThatAreShared) {
  constexpr int largest = std::numeric_limits<int>::max();
  const std::vector<int> ids{
      0, 1, 2, 3, 3, 3, 9, 9, -1, -2, -1, largest, largest - 1, 1 << 16, (1 << 16) + 1};
  Random random(1);
  Twins twins(ids);
  ASSERT_NO_FATAL_FAILURE(twins.play(10000, random));
  EXPECT_GT(twins.most_pairs(), 10U);
}

TEST(BulletPairCache, ContactsOfPairsAtRestAreNotPrefetched) {
  constexpr std::size_t count = 20;
  Side<PairCache> side;
  std::array<btCollisionObject, count> objects;
  std::array<btBroadphaseProxy, count> proxies;
  for (std::size_t k = 0; k < count; ++k) {
    proxies[k] = btBroadphaseProxy(btVector3(0, 0, 0), btVector3(1, 1, 1), &objects[k], 1, -1);
    proxies[k].m_uniqueId = static_cast<int>(k);
  }
  int looks = 0;
  for (std::size_t k = 1; k < count; ++k) {
    side.cache.addOverlappingPair(&proxies[k - 1], &proxies[k])->m_algorithm = test::MortalAlgorithm::make(
        side.dispatcher, [] {}, [&] { ++looks; });
  }
  const auto looks_of_all = [&] {
    looks = 0;
    Record record;
    side.cache.processAllOverlappingPairs(&record, &side.dispatcher, btDispatcherInfo());
    EXPECT_EQ(record.pairs.back().size(), count - 1);
    return looks;
  };
  EXPECT_GT(looks_of_all(), 10);
  for (btCollisionObject& object : objects) object.forceActivationState(ISLAND_SLEEPING);
  EXPECT_EQ(looks_of_all(), 0);
  objects[count / 2].forceActivationState(ACTIVE_TAG);
  EXPECT_EQ(looks_of_all(), 2);
  for (btBroadphaseProxy& proxy : proxies) proxy.m_clientObject = nullptr;
  EXPECT_GT(looks_of_all(), 10);
  for (btBroadphaseProxy& proxy : proxies) {
    side.cache.removeOverlappingPairsContainingProxy(&proxy, &side.dispatcher);
  }
}

TEST(BulletPairCache, WithItTheAdapterDoesTheSame) {
  const test::Kind& broadcl = test::kinds[0];
  btHashedOverlappingPairCache bullets;
  test::Rig ours(broadcl);
  test::Rig theirs(broadcl, &bullets);
  ASSERT_NE(dynamic_cast<PairCache*>(&ours.cache()), nullptr);
  ASSERT_EQ(&theirs.cache(), &bullets);
  Random random(2);
  int most = 0;
  for (int frame = 0; frame < 60; ++frame) {
    for (int call = 0; call < 25; ++call) {
      const Eigen::Vector3f corner = random.vector(0, 9);
      const btVector3 lower(corner.x(), corner.y(), corner.z());
      const btVector3 upper = lower + btVector3(2, 2, 2);
      const auto live = static_cast<std::uint32_t>(ours.proxies().size());
      const std::uint32_t what = random.index(10);
      const std::size_t k = live == 0 ? 0 : random.index(live);
      for (test::Rig* rig : {&ours, &theirs}) {
        if (live < 20 || what < 3) {
          rig->create(lower, upper);
        } else if (what < 5) {
          rig->destroy(rig->proxies()[k]);
        } else {
          rig->move(rig->proxies()[k], lower, upper);
        }
      }
    }
    ours.calculate();
    theirs.calculate();
    ASSERT_EQ(ours.ids(), theirs.ids()) << "frame " << frame;
    most = std::max(most, ours.pair_count());
  }
  EXPECT_GT(most, 50);
}

}  // namespace
}  // namespace broadcl
