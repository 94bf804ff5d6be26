#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/CollisionDispatch/btCollisionDispatcher.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

#include "bullet_short_life.hpp"
#include "device_limits.hpp"
#include "each_algorithm.hpp"
#include "environment.hpp"
#include "failing_opencl.hpp"
#include "forked_child.hpp"
#include "patience.hpp"
#include "process_memory.hpp"
#include "runs.hpp"
#include "started_threads.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

SUITE_NOT_IN(BulletFailure, sanitizers, "fails on purpose, also where buffers are unmapped, and takes long");

using test::FailingOpenCl;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr long most_lives = 25;

using Life = test::AdapterLife<>;

/// Moves thousands of other proxies until `auto` has opened its GPU, in another thread, and uses it.
void move_until_on_device(Life& life) {
  BulletBroadphase& broadphase = life.broadphase();
  btDispatcher* const dispatcher = &life.dispatcher();
  std::vector<btBroadphaseProxy*> others;
  for (int k = 0; k < 20'000; ++k) {
    const btVector3 lower(0, 0, btScalar(10 + 2 * k));
    others.push_back(broadphase.createProxy(lower, lower + btVector3(1, 1, 1), BOX_SHAPE_PROXYTYPE, &life, 1,
                                            3, dispatcher));
  }
  const auto start = std::chrono::steady_clock::now();
  for (btScalar step = 1; !life.is_on_device(); step = -step) {
    ASSERT_LT(std::chrono::steady_clock::now() - start, test::patience);
    for (btBroadphaseProxy* proxy : others) {
      const btVector3 by(step, 0, 0);
      broadphase.setAabb(proxy, proxy->m_aabbMin + by, proxy->m_aabbMax + by, dispatcher);
    }
    broadphase.calculateOverlappingPairs(dispatcher);
  }
  for (btBroadphaseProxy* proxy : others) broadphase.destroyProxy(proxy, dispatcher);
  broadphase.calculateOverlappingPairs(dispatcher);
}

class BulletFailure : public ::testing::TestWithParam<AlgorithmInfo> {};

TEST_P(BulletFailure, WhicheverCallFailsFirstThePairsAreRightAndItIsReportedOnce) {
  long calls = 0;
  {
    Life life(GetParam().name);
    const FailingOpenCl nothing_fails(0, 0);
    life.live();
    calls = FailingOpenCl::calls();
    EXPECT_THAT(life.errors(), SizeIs(0));
    if (GetParam().name == "auto" && !life.is_on_device()) return;  // a GPU is opened later
    EXPECT_TRUE(life.is_on_device());
  }
  ASSERT_GT(calls, 50);
  const long step = std::max(1L, calls / most_lives);
  for (long first = 0; first < calls; first += step) {
    SCOPED_TRACE("from call " + std::to_string(first) + " on");
    std::optional<Life> life(std::in_place, GetParam().name);
    const FailingOpenCl all_fail(first, calls * 100);
    life->live();
    ASSERT_THAT(life->errors(), ElementsAre(HasSubstr("sweep and prune")));
    ASSERT_FALSE(life->is_on_device());
    life.reset();  // while calls fail
  }
}

TEST_P(BulletFailure, ASingleFailureIsSurvivedToo) {
  for (long first = 0; first < 3 * most_lives; first += 3) {
    SCOPED_TRACE("call " + std::to_string(first));
    Life life(GetParam().name);
    const FailingOpenCl one_fails(first, 1);
    life.live();
    ASSERT_LE(life.errors().size(), 1U);
    // (`auto` starts on the host if the device is a GPU.)
    const bool left_by_itself = GetParam().name == "auto" && !life.is_on_device() && life.errors().empty();
    ASSERT_TRUE(left_by_itself || life.is_on_device() == life.errors().empty());
    if (FailingOpenCl::calls() < first) break;
  }
}

TEST_P(BulletFailure, InAForkedChildTheHostTakesOver) {
  Life life(GetParam().name);
  life.live();
  for (const bool is_begun : {false, true}) {
    if (is_begun) life.begin();
    EXPECT_TRUE(test::holds_in_child([&] {
      const std::size_t errors = life.is_on_device() ? 1 : 0;
      life.live();
      life.rest();
      EXPECT_FALSE(life.is_on_device());
      EXPECT_THAT(life.errors(), SizeIs(errors));
      EXPECT_THAT(life.errors(), ::testing::Each(HasSubstr("after a fork")));
    })) << is_begun;
  }
  life.live();
  EXPECT_THAT(life.errors(), SizeIs(0));
}

/// Far too many pairs for the memory, then few again.
TEST(BulletFailure, ARealShortageOfMemoryEndsWhenThereIsEnough) {
  EXPECT_TRUE(test::holds_in_child([] {
    test::limit_memory(std::size_t{1} << 30U);
    btDefaultCollisionConfiguration configuration;
    btCollisionDispatcher dispatcher(&configuration);
    std::vector<std::string> errors;
    BulletBroadphase broadphase({.algorithm = "sweep-and-prune", .threads = 2});
    broadphase.set_error_handler([&](const std::string& error) { errors.push_back(error); });
    std::vector<btBroadphaseProxy*> proxies;
    proxies.reserve(40'000);
    const auto lower = [](int k) { return btVector3(btScalar(2 * k), 0, 0); };
    const btVector3 size(1, 1, 1);
    for (int k = 0; k < 40'000; ++k) {
      proxies.push_back(broadphase.createProxy(lower(k), lower(k) + size, BOX_SHAPE_PROXYTYPE, &broadphase, 1,
                                               1, &dispatcher));
    }
    broadphase.calculateOverlappingPairs(&dispatcher);
    const auto move_all = [&](int places) {
      for (int k = 0; k < 40'000; ++k) {
        const btVector3 at = lower(k % places);
        broadphase.setAabb(proxies[static_cast<std::size_t>(k)], at, at + size, &dispatcher);
      }
    };
    for (const bool is_begun : {false, true}) {
      errors.clear();
      move_all(1);
      if (is_begun) broadphase.begin();
      if (is_begun) move_all(10'000);  // which the search that has begun does not find
      broadphase.calculateOverlappingPairs(&dispatcher);
      EXPECT_THAT(errors, ElementsAre(HasSubstr("memory is exhausted")));
      move_all(20'000);
      broadphase.calculateOverlappingPairs(&dispatcher);
      EXPECT_EQ(broadphase.getOverlappingPairCache()->getNumOverlappingPairs(), 20'000);
      EXPECT_THAT(errors, SizeIs(1));
      EXPECT_NO_THROW(std::vector<char>(std::size_t{500} << 20U)) << "it keeps memory";
    }
    for (btBroadphaseProxy* proxy : proxies) broadphase.destroyProxy(proxy, &dispatcher);
  }));
}

/// If one call fails, `auto` leaves the GPU by itself. The adapter reports that and continues, as if all
/// calls failed.
ALSO_IN(kernels);
TEST(BulletFailure, AutoLeavesAGpuThatFails) {
  const test::ScopedFolder cache;
  const test::ScopedVariable caches("BROADCL_CACHE_DIR", cache.path().string());
  const test::ScopedVariable gpu("BROADCL_DEVICE", "gpu");
  const test::ScopedVariable by_the_device("BROADCL_TUNING", "");
  const test::LimitedDevices limited(test::gpu_with_waves_of(32));
  int failures = 0;
  for (long first = 0; first < 200; first += 8) {
    SCOPED_TRACE("call " + std::to_string(first));
    Life life("auto");
    move_until_on_device(life);
    const FailingOpenCl one_fails(first, 1);
    life.live();
    if (life.errors().empty()) continue;  // what failed was not needed, or the host was faster
    ++failures;
    ASSERT_THAT(life.errors(), ElementsAre(HasSubstr("sweep and prune")));
    ASSERT_FALSE(life.is_on_device());
  }
  EXPECT_GT(failures, 5);
}

TEST(BulletFailure, TheHostUsesAsManyThreadsAsTheDeviceWouldHave) {
  if (std::thread::hardware_concurrency() < 2) GTEST_SKIP() << "there is only one processor";
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  BulletBroadphase broadphase({.algorithm = "brute-force", .threads = 1});
  std::vector<btBroadphaseProxy*> proxies;
  for (int k = 0; k < 20'000; ++k) {
    const btVector3 lower(btScalar(2 * k), 0, 0);
    proxies.push_back(broadphase.createProxy(lower, lower + btVector3(1, 1, 1), BOX_SHAPE_PROXYTYPE,
                                             &broadphase, 1, -1, &dispatcher));
  }
  const FailingOpenCl all_fail(0, 1'000'000);
  broadphase.calculateOverlappingPairs(&dispatcher);
  ASSERT_EQ(broadphase.broad_phase().device(), nullptr);
  const long before = test::started_threads();
  for (btBroadphaseProxy* proxy : proxies) {
    broadphase.setAabb(proxy, proxy->m_aabbMin, proxy->m_aabbMax + btVector3(1, 0, 0), &dispatcher);
  }
  broadphase.calculateOverlappingPairs(&dispatcher);
  EXPECT_EQ(broadphase.getOverlappingPairCache()->getNumOverlappingPairs(), 19'999);
  EXPECT_EQ(test::started_threads(), before);
  for (btBroadphaseProxy* proxy : proxies) broadphase.destroyProxy(proxy, &dispatcher);
}

/// No search is left to the host.
ALSO_IN(kernels);
TEST(BulletFailure, AKernelThatRunsOnlyInSmallWorkGroupsIsNone) {
  const test::ScopedVariable any("BROADCL_DEVICE", "");
  const test::ScopedVariable by_the_device("BROADCL_TUNING", "");
  test::Limits gpu = test::gpu_with_waves_of(32);
  gpu.work_group_of_kernel = {{"tiles_search", 16}};
  const test::LimitedDevices limited(gpu);
  Life life("tiles");
  life.live();
  life.rest();
  EXPECT_THAT(life.errors(), SizeIs(0));
  EXPECT_TRUE(life.is_on_device());
}

std::vector<AlgorithmInfo> device_algorithms() {
  std::vector<AlgorithmInfo> result;
  for (const AlgorithmInfo& info : algorithms()) {
    if (info.on_device) result.push_back(info);
  }
  return result;
}

INSTANTIATE_TEST_SUITE_P(Table, BulletFailure, testing::ValuesIn(device_algorithms()),
                         test::named_by_parameter);

}  // namespace
}  // namespace broadcl
