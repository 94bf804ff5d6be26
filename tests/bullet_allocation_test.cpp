// Failed allocations of host memory while Bullet calls its broad phase: a call that throws has changed
// nothing, and the next calculation that gets its memory leaves the right pairs.
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/CollisionDispatch/btCollisionDispatcher.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>
#include <LinearMath/btAabbUtil2.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <ostream>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

#include "failing_allocations.hpp"
#include "test_name.hpp"
#include "trouble.hpp"

namespace broadcl::test {
namespace {

using AllocationTrouble = Trouble<FailingAllocations, FailingAllocations::allocations>;
using IdPairs = std::vector<std::pair<int, int>>;

constexpr auto nothing_more = [] {};

/// Counts the proxies that a box query finds.
struct Count final : btBroadphaseAabbCallback {
  bool process(const btBroadphaseProxy* /*proxy*/) override {
    ++found;
    return true;
  }
  std::size_t found = 0;
};

/// Proxies that are created, moved, filtered and destroyed in each frame, always the same way.
class AdapterLife {
 public:
  /// @param cache May be null.
  AdapterLife(const char* algorithm, btOverlappingPairCache* cache, bool at_once, AllocationTrouble trouble)
      : broadphase_({.algorithm = algorithm}, cache), trouble_(trouble) {
    broadphase_.set_pairs_at_once(at_once);
    broadphase_.set_error_handler([this](const std::string& /*error*/) { ++errors_; });
  }

  void live() {
    for (int frame = 0; frame < 5; ++frame) {
      SCOPED_TRACE("frame " + std::to_string(frame));
      change();
      if (frame % 2 == 1) {
        trouble_.call([&] { broadphase_.begin(); }, nothing_more);
        change();
      }
      for (int k = 0; k < 5; ++k) expect_queries_find_all();
      trouble_.call([&] { broadphase_.calculateOverlappingPairs(&dispatcher_); }, nothing_more);
      broadphase_.calculateOverlappingPairs(&dispatcher_);  // nothing fails
      ASSERT_EQ(cached(), overlapping());
    }
    while (!proxies_.empty()) destroy(proxies_.size() / 2);
    EXPECT_EQ(cached().size(), 0U);
  }

  [[nodiscard]] long points() const { return trouble_.points(); }
  [[nodiscard]] int errors() const { return errors_; }

 private:
  btVector3 corner() { return {static_cast<btScalar>(random_() % 50) / 10, btScalar(random_() % 2), 0}; }

  void create() {
    const btVector3 lower = corner();
    const auto group = static_cast<int>(1 + random_() % 2);
    btBroadphaseProxy* proxy = trouble_.call(
        [&] {
          return broadphase_.createProxy(lower, lower + btVector3(1, 1, 1), 0, this, group, 3, &dispatcher_);
        },
        nothing_more);
    EXPECT_EQ(proxy->m_uniqueId, lowest_free_id());
    proxies_.push_back(proxy);
  }

  void destroy(std::size_t k) {
    trouble_.call([&] { broadphase_.destroyProxy(proxies_[k], &dispatcher_); }, nothing_more);
    proxies_.erase(proxies_.begin() + static_cast<std::ptrdiff_t>(k));
  }

  void change() {
    for (std::size_t k = 0; k < proxies_.size(); k += 3) {
      const btVector3 lower = corner();
      trouble_.call(
          [&] { broadphase_.setAabb(proxies_[k], lower, lower + btVector3(1, 1, 1), &dispatcher_); },
          nothing_more);
    }
    for (std::size_t k = 0; k < proxies_.size(); k += 7) {
      proxies_[k]->m_collisionFilterMask ^= 1;
      destroy(k);
    }
    for (int k = 0; k < 12; ++k) create();
  }

  void expect_queries_find_all() {
    Count count;
    trouble_.call([&] { broadphase_.aabbTest({-9, -9, -9}, {9, 9, 9}, count); }, nothing_more);
    EXPECT_EQ(count.found, proxies_.size());
  }

  [[nodiscard]] int lowest_free_id() const {
    int id = 0;
    const auto has_id = [&](const btBroadphaseProxy* proxy) { return proxy->m_uniqueId == id; };
    while (std::any_of(proxies_.begin(), proxies_.end(), has_id)) ++id;
    return id;
  }

  IdPairs cached() {
    IdPairs pairs;
    const btBroadphasePairArray& array = broadphase_.getOverlappingPairCache()->getOverlappingPairArray();
    for (int k = 0; k < array.size(); ++k) {
      pairs.emplace_back(array[k].m_pProxy0->m_uniqueId, array[k].m_pProxy1->m_uniqueId);
    }
    std::sort(pairs.begin(), pairs.end());
    return pairs;
  }

  [[nodiscard]] IdPairs overlapping() const {
    IdPairs pairs;
    for (const btBroadphaseProxy* s : proxies_) {
      for (const btBroadphaseProxy* t : proxies_) {
        if (s->m_uniqueId < t->m_uniqueId &&
            TestAabbAgainstAabb2(s->m_aabbMin, s->m_aabbMax, t->m_aabbMin, t->m_aabbMax) &&
            (s->m_collisionFilterGroup & t->m_collisionFilterMask) != 0 &&
            (t->m_collisionFilterGroup & s->m_collisionFilterMask) != 0) {
          pairs.emplace_back(s->m_uniqueId, t->m_uniqueId);
        }
      }
    }
    std::sort(pairs.begin(), pairs.end());
    return pairs;
  }

  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  BulletBroadphase broadphase_;
  AllocationTrouble trouble_;
  int errors_ = 0;
  std::vector<btBroadphaseProxy*> proxies_;
  std::mt19937 random_{1};  // NOLINT(bugprone-random-generator-seed): the same life each time
};

/// A class whose way of filtering the adapter cannot know.
class UsersCache final : public btHashedOverlappingPairCache {};

struct Kind {
  const char* name;
  const char* algorithm;
  bool at_once;
  std::unique_ptr<btOverlappingPairCache> (*make_cache)();
};

std::ostream& operator<<(std::ostream& out, const Kind& kind) {
  return out << kind.name;
}

template <class Cache>
std::unique_ptr<btOverlappingPairCache> make() {
  return std::make_unique<Cache>();
}

constexpr auto none = [] { return std::unique_ptr<btOverlappingPairCache>(); };

class BulletAllocation : public ::testing::TestWithParam<Kind> {
 protected:
  /// Runs a life in which allocation 0 fails, one in which allocation 1 fails, and so on; on a device, where
  /// each takes longer, only every 20th.
  static void live(long count) {
    const Kind& kind = GetParam();
    long failures_told = 0;
    const long step = std::string_view(kind.algorithm) == "sweep-and-prune" ? 1 : 20;
    for (long first = 0, points = 1; first < points; first += step) {
      SCOPED_TRACE("allocation " + std::to_string(first));
      const std::unique_ptr<btOverlappingPairCache> cache = kind.make_cache();
      AdapterLife life(kind.algorithm, cache.get(), kind.at_once, AllocationTrouble(first, count));
      ASSERT_NO_FATAL_FAILURE(life.live());
      ASSERT_FALSE(HasFailure());
      if (count == 1) {
        ASSERT_LE(life.errors(), 1);
      }
      points = life.points();
      failures_told += life.errors();
    }
    EXPECT_GT(failures_told, 4);  // recovery from the others needed no report
  }
};

TEST_P(BulletAllocation, EachThatFailsOnceIsMadeGood) {
  live(1);
}

TEST_P(BulletAllocation, EachFromWhichOnAllFailIsMadeGood) {
  live(AllocationTrouble::for_good);
}

INSTANTIATE_TEST_SUITE_P(
    Cache, BulletAllocation,
    ::testing::Values(Kind{"OwnOnDevice", "brute-force", false, none},
                      Kind{"OwnAtOnce", "sweep-and-prune", true, none},
                      Kind{"Hashed", "sweep-and-prune", false, make<btHashedOverlappingPairCache>},
                      Kind{"UsersAtOnce", "sweep-and-prune", true, make<UsersCache>},
                      Kind{"SortedAtOnce", "sweep-and-prune", true, make<btSortedOverlappingPairCache>}),
    named_by_parameter);

}  // namespace
}  // namespace broadcl::test
