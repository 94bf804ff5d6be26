// Statements 25 to 28 of Bullet's contract: rays and box queries.
#include <LinearMath/btAabbUtil2.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <limits>
#include <set>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "bullet_contract.hpp"
#include "query_rig.hpp"
#include "runs.hpp"

namespace broadcl::test {
namespace {

TEST_P(Contract, S25QueriesSeeChangesAtOnce) {
  QueryRig rig(GetParam());
  int client = 0;
  for (int round = 0; round < 100; ++round) {  // enough queries that those with a tree use it
    const btScalar x = 100 + static_cast<btScalar>(round % 7);
    const auto seen = [&](btScalar at) {
      const bool by_box = rig.boxes({at, 0, 0}, {at + 1, 1, 1}).contains(&client);
      const bool by_ray =
          rig.rays({at + btScalar(0.5), 0.5F, -5}, {at + btScalar(0.5), 0.5F, 5}).contains(&client);
      EXPECT_EQ(by_box, by_ray || GetParam().name == "Simple");
      return by_box && by_ray;
    };
    btBroadphaseProxy* proxy = rig.create_unit(x, 1, all_bits, &client);
    EXPECT_TRUE(seen(x));
    rig.move(proxy, x + 300);
    EXPECT_TRUE(seen(x + 300));
    rig.destroy(proxy);
    const std::multiset<const void*> boxes = rig.boxes({0, 0, 0}, {900, 9, 9});
    const std::multiset<const void*> rays = rig.rays({0, 0.5F, 0.5F}, {900, 0.5F, 0.5F});
    for (const void* gone : {static_cast<const void*>(&client), static_cast<const void*>(nullptr)}) {
      EXPECT_FALSE(boxes.contains(gone));
      EXPECT_FALSE(rays.contains(gone));
    }
  }
}

TEST_P(Contract, S26RaysReportEveryBoxThatTheyPass) {
  QueryRig rig(GetParam());
  const btVector3 plane(btScalar(BT_LARGE_FLOAT), 1, btScalar(BT_LARGE_FLOAT));
  int plane_client = 0;
  rig.move(rig.create(-plane, plane, 1, 1, &plane_client), -plane, plane);
  Random random(9);
  int passed = 0;
  for (int round = 0; round < 600; ++round) {
    const btVector3 from = random.point(22);
    btVector3 to = random.point(22);
    for (unsigned axis = 0; axis < 3; ++axis) {
      if ((static_cast<unsigned>(round) >> axis & 1U) != 0)
        to[static_cast<int>(axis)] = from[static_cast<int>(axis)];
    }
    const bool is_swept = round % 5 == 0;
    const btVector3 lower = is_swept ? -random.point(2) : btVector3(0, 0, 0);
    const btVector3 upper = is_swept ? random.point(2) : btVector3(0, 0, 0);
    RayCollector collector(from, to);
    rig.broadphase().rayTest(from, to, collector, lower, upper);
    for (const btBroadphaseProxy* proxy : rig.proxies()) {
      const std::size_t reports = collector.found.count(proxy->m_clientObject);
      ASSERT_LE(reports, 1U);
      if (!collector.must_report(*proxy, from, lower, upper)) continue;
      ASSERT_EQ(reports, 1U) << "round " << round;
      ++passed;
    }
    if (round % 20 == 0) {
      const btVector3 corner = random.point(20);
      rig.move(rig.proxies()[random.below(400)], corner, corner + btVector3(2, 2, 2));
    }
  }
  EXPECT_GT(passed, 1000);
}

TEST_P(Contract, S26ASweepOfNoLengthReportsTheBoxesAroundItsStart) {
  QueryRig rig(GetParam());
  int client = 0;
  rig.create({100, 100, 100}, {102, 102, 102}, 1, 1, &client);
  for (int round = 0; round < 100; ++round) {
    const btVector3 point(101, 101, 101);
    ASSERT_EQ(rig.rays(point, point).count(&client), 1U);
  }
}

TEST_P(Contract, S27BoxQueriesAreInclusiveAndIgnoreFilters) {
  QueryRig rig(GetParam());
  Random random(10);
  int touched = 0;
  for (int round = 0; round < 1000; ++round) {
    const btVector3 lower = random.point(20);
    const btVector3 upper = lower + random.point(4);
    const std::multiset<const void*> found = rig.boxes(lower, upper);
    for (const btBroadphaseProxy* proxy : rig.proxies()) {
      const std::size_t reports = found.count(proxy->m_clientObject);
      ASSERT_LE(reports, 1U);
      if (!TestAabbAgainstAabb2(lower, upper, proxy->m_aabbMin, proxy->m_aabbMax)) continue;
      ASSERT_EQ(reports, 1U) << "round " << round;
      ++touched;
    }
  }
  EXPECT_GT(touched, 1000);
  const btBroadphaseProxy* first = rig.proxies().front();
  EXPECT_TRUE(rig.boxes(first->m_aabbMax, first->m_aabbMax).contains(first->m_clientObject));
}

constexpr std::string_view shared_stack = "all queries share a stack if Bullet has no BT_THREADSAFE";

TEST_P(Contract, S28AQueryMayAskAnother) {
  if (unfit("Tree", shared_stack) || unfit("Sweep", shared_stack)) return;
  struct Nesting final : RayCollector {
    Nesting(QueryRig& asked, const btVector3& from, const btVector3& to)
        : RayCollector(from, to), rig(asked) {}
    bool process(const btBroadphaseProxy* proxy) override {
      inner = rig.rays({0, 10, 10}, {22, 10, 10});
      boxes = rig.boxes({0, 0, 0}, {9, 9, 9});
      return RayCollector::process(proxy);
    }
    QueryRig& rig;
    std::multiset<const void*> inner;
    std::multiset<const void*> boxes;
  };
  QueryRig rig(GetParam());
  const auto outer = rig.rays({0, 9, 9}, {22, 11, 11});
  const auto inner = rig.rays({0, 10, 10}, {22, 10, 10});
  ASSERT_GT(outer.size(), 2U);
  for (int round = 0; round < 100; ++round) {
    btBroadphaseProxy* proxy = rig.proxies()[static_cast<std::size_t>(round)];
    rig.move(proxy, proxy->m_aabbMin + btVector3(50, 0, 0), proxy->m_aabbMax + btVector3(50, 0, 0));
    rig.move(proxy, proxy->m_aabbMin - btVector3(50, 0, 0), proxy->m_aabbMax - btVector3(50, 0, 0));
    Nesting nesting(rig, {0, 9, 9}, {22, 11, 11});
    rig.broadphase().rayTest({0, 9, 9}, {22, 11, 11}, nesting);
    ASSERT_EQ(nesting.found, outer);
    ASSERT_EQ(nesting.inner, inner);
    ASSERT_GT(nesting.boxes.size(), 10U);
  }
}

TEST_P(Contract, S28QueriesMayRunInSeveralThreads) {
  if (unfit("Tree", shared_stack) || unfit("Sweep", shared_stack)) return;
  QueryRig rig(GetParam());
  std::vector<std::pair<btVector3, btVector3>> rays;
  constexpr std::size_t n = 100;
  Random random(11);
  rays.reserve(n);
  while (rays.size() < n) rays.emplace_back(random.point(22), random.point(22));
  std::vector<std::multiset<const void*>> expected;
  expected.reserve(n);
  for (const auto& [from, to] : rays) expected.push_back(rig.rays(from, to));
  for (int round = 0; round < 20; ++round) {
    // Something changes, so that all threads find the tree out of date.
    for (btBroadphaseProxy* proxy : rig.proxies()) {
      if (random.below(8) != 0) continue;
      const btVector3 lower = proxy->m_aabbMin;
      const btVector3 upper = proxy->m_aabbMax;
      rig.move(proxy, upper, upper);
      rig.move(proxy, lower, upper);
    }
    std::array<std::vector<std::multiset<const void*>>, 4> results;
    std::vector<std::thread> threads;
    threads.reserve(results.size());
    for (auto& result : results) {
      threads.emplace_back([&rig, &rays, &result] {
        for (const auto& [from, to] : rays) result.push_back(rig.rays(from, to));
      });
    }
    for (std::thread& thread : threads) thread.join();
    for (const auto& result : results) ASSERT_EQ(result, expected) << "round " << round;
  }
}

/// Whether something holds in one of a few tries: other programs may have the processor during one of them.
template <class Condition>
bool holds_once(const Condition& condition) {
  for (int k = 0; k < 10; ++k) {
    if (condition()) return true;
  }
  return false;
}

/// The tree must not be deeper for objects that were created along a line.
NOT_IN(sanitizers, "measures time");
TEST(BulletQueries, InALineTakeAsLongAsInAnyOrder) {
  constexpr int n = 4000;
  const auto seconds_of_rays = [](int step) {  // from each object to the next
    Rig rig(kinds.front());
    for (int k = 0; k < n; ++k) rig.create_unit(static_cast<btScalar>(2 * (k * step % n)));
    const auto start = std::chrono::steady_clock::now();
    for (int k = 0; k < 500; ++k) {
      const auto x = static_cast<btScalar>(2 * k + 0.5);
      RayCollector collector({x, 0.5F, -5}, {x, 0.5F, 5});
      rig.broadphase().rayTest({x, 0.5F, -5}, {x, 0.5F, 5}, collector);
      EXPECT_EQ(collector.found.size(), 1U);
    }
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  EXPECT_TRUE(holds_once([&] { return seconds_of_rays(1) < 5 * seconds_of_rays(1789); }));
}

/// The tree must not become a list if boxes are equal, whether they are new or have moved.
NOT_IN(sanitizers, "measures time");
TEST(BulletQueries, BesideEqualBoxesTakeAsLongAsBesideOthers) {
  constexpr int n = 10'000;
  const auto seconds_of_queries = [](btScalar distance) {
    Rig rig(kinds.front());
    for (int k = 0; k < n; ++k) rig.create_unit(distance * static_cast<btScalar>(k));
    const auto start = std::chrono::steady_clock::now();
    constexpr int part = n / 10;
    for (int frame = 0; frame < 10; ++frame) {  // a tenth leaves, that of the last frame returns
      for (int k = std::max(0, frame - 1) * part; k < (frame + 1) * part; ++k) {
        const btScalar place = distance * static_cast<btScalar>(k);
        rig.move(rig.proxies()[static_cast<std::size_t>(k)],
                 k < frame * part ? place : place - 1000 - 2 * static_cast<btScalar>(k));
      }
      for (int k = 0; k < 200; ++k) {
        RayCollector collector({-5, 5, -5}, {-5, 5, 5});
        rig.broadphase().rayTest({-5, 5, -5}, {-5, 5, 5}, collector);
        EXPECT_TRUE(collector.found.empty());
      }
    }
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  EXPECT_TRUE(holds_once([&] { return seconds_of_queries(0) < 5 * seconds_of_queries(2); }));
}

/// The tree then has a box that no calculation has taken out, since there was nothing to calculate.
TEST(BulletQueries, FindNothingWhenTheLastProxyIsGone) {
  for (const Kind& kind : kinds) {
    Rig rig(kind);
    btBroadphaseProxy* const proxy = rig.create_unit(0);
    const auto boxes = [&] {
      BoxCollector collector;
      rig.broadphase().aabbTest({0, 0, 0}, {1, 1, 1}, collector);
      return collector.found.size();
    };
    for (int k = 0; k < 20; ++k) EXPECT_EQ(boxes(), 1U);  // so often that the tree reads it
    rig.destroy(proxy);
    rig.calculate();
    EXPECT_EQ(boxes(), 0U) << kind.name;
  }
}

/// While it exists, Bullet's allocator has memory for some more allocations, and then returns null.
class BulletMemory {
 public:
  BulletMemory() {
    btAlignedAllocSetCustomAligned(
        [](std::size_t bytes, int alignment) {
          const auto multiple = static_cast<std::size_t>(alignment);
          return allocations_left-- > 0
                     ? std::aligned_alloc(multiple, (bytes + multiple - 1) / multiple * multiple)
                     : nullptr;
        },
        std::free);
  }
  ~BulletMemory() { btAlignedAllocSetCustomAligned(nullptr, nullptr); }
  BulletMemory(const BulletMemory&) = delete;
  BulletMemory& operator=(const BulletMemory&) = delete;

  static void set(int allocations) noexcept { allocations_left = allocations; }
  static constexpr int plenty = std::numeric_limits<int>::max();

 private:
  inline static int allocations_left = plenty;
};

/// They scan until there is memory for a tree, or for more nodes of one.
TEST(BulletQueries, NeedNoMemory) {
  const btVector3 lower(4, 4, 4);
  const btVector3 upper(12, 12, 12);
  for (const int allocations : {0, 1, 2, 3, 100, 900}) {
    const BulletMemory memory;
    QueryRig rig(kinds.front());
    Random random(12);
    for (int round = 0; round < 200; ++round) {
      if (round % 20 == 0) {
        const btVector3 corner = random.point(20);
        rig.move(rig.proxies()[random.below(400)], corner, corner + btVector3(2, 2, 2));
        const btVector3 other = random.point(20);
        rig.move(rig.create(other, other, 1, 1, rig.proxies()[random.below(400)]->m_clientObject), other,
                 other + btVector3(1, 1, 1));
      }
      std::multiset<const void*> expected;
      for (const btBroadphaseProxy* proxy : rig.proxies()) {
        if (TestAabbAgainstAabb2(lower, upper, proxy->m_aabbMin, proxy->m_aabbMax)) {
          expected.insert(proxy->m_clientObject);
        }
      }
      // At first there is enough, so that there is a tree to which nodes are added.
      BulletMemory::set(round < 100 ? BulletMemory::plenty : allocations);
      ASSERT_EQ(rig.boxes(lower, upper), expected) << round << " with " << allocations;
      BulletMemory::set(BulletMemory::plenty);
    }
  }
}

}  // namespace
}  // namespace broadcl::test
