// Failed allocations of host memory while Bullet calls its broad phase: a call that throws has changed
// nothing, and the next calculation that gets its memory leaves the right pairs.
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <cstddef>
#include <memory>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/bullet.hpp>

#include "bullet_short_life.hpp"
#include "failing_allocations.hpp"
#include "ray_callback.hpp"
#include "test_name.hpp"
#include "trouble.hpp"

namespace broadcl::test {
namespace {

using AllocationTrouble = Trouble<FailingAllocations, FailingAllocations::allocations>;
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
    std::size_t failures_told = 0;
    const long step = std::string_view(kind.algorithm) == "sweep-and-prune" ? 1 : 20;
    for (long first = 0, points = 1; first < points; first += step) {
      SCOPED_TRACE("allocation " + std::to_string(first));
      const std::unique_ptr<btOverlappingPairCache> cache = kind.make_cache();
      AdapterLife<AllocationTrouble> life(kind.algorithm, cache.get(), kind.at_once,
                                          AllocationTrouble(first, count));
      ASSERT_NO_FATAL_FAILURE(life.live());
      life.end();
      ASSERT_FALSE(HasFailure());
      if (count == 1) {
        ASSERT_LE(life.error_count(), 1U);
      }
      points = life.trouble().points();
      failures_told += life.error_count();
    }
    EXPECT_GT(failures_told, 4U);  // recovery from the others needed no report
  }
};

TEST_P(BulletAllocation, EachThatFailsOnceIsMadeGood) {
  live(1);
}

TEST_P(BulletAllocation, EachFromWhichOnAllFailIsMadeGood) {
  live(AllocationTrouble::for_good);
}

/// Queries test all proxies if there is no memory to read those that moved into a tree.
TEST(BulletQueriesWithoutMemory, FindTheSame) {
  struct CountingRay final : RayCallback {
    using RayCallback::RayCallback;
    bool process(const btBroadphaseProxy* /*proxy*/) override {
      ++found;
      return true;
    }
    int found = 0;
  };
  constexpr int n = 600;
  const btVector3 size(1, 1, 1);
  long points = 1;
  for (long first = 0; first < points; ++first) {
    BulletBroadphase broadphase({.algorithm = "sweep-and-prune", .threads = 1});
    std::vector<btBroadphaseProxy*> proxies;
    for (int k = 0; k < n; ++k) {
      const btVector3 lower(btScalar(2 * k), 0, 0);
      proxies.push_back(broadphase.createProxy(lower, lower + size, 0, nullptr, 1, -1, nullptr));
    }
    broadphase.calculateOverlappingPairs(nullptr);
    for (int k = 0; k < n; k += 2) {
      const btVector3 lower(btScalar(2 * k + 1), 0, 0);
      broadphase.setAabb(proxies[static_cast<std::size_t>(k)], lower, lower + size, nullptr);
    }
    {
      const FailingAllocations failing(first, AllocationTrouble::for_good);
      for (int query = 0; query < 20; ++query) {
        const btVector3 from(-5, 0.5F, 0.5F);
        const btVector3 to(2 * n, 0.5F, 0.5F);
        CountingRay ray(from, to);
        broadphase.rayTest(from, to, ray);
        ASSERT_EQ(ray.found, n);
      }
      points = FailingAllocations::allocations();
    }
    for (btBroadphaseProxy* proxy : proxies) broadphase.destroyProxy(proxy, nullptr);
  }
  EXPECT_GT(points, 1) << "the tree was never read";
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
