#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <iterator>
#include <limits>
#include <random>
#include <set>

#include <gtest/gtest.h>

#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "scenes/generators.hpp"

namespace broadcl {
namespace {

SUITE_ALSO_IN(BruteForce, gpu_profile | rusticl);

using test::apart;
using test::EachAlgorithm;
using test::unit;
using ::testing::HasSubstr;

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();
std::string test_name(const ::testing::TestParamInfo<AlgorithmInfo>& info) {
  std::string name(info.param.name);
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

// For all files: gtest gathers the tests of the suite wherever they are.
INSTANTIATE_TEST_SUITE_P(Table, EachAlgorithm, ::testing::ValuesIn(algorithms().begin(), algorithms().end()),
                         test_name);

TEST_P(EachAlgorithm, EveryPairIsFoundAlone) {
  for (const std::uint32_t n : {2U, 7U, 19U}) {
    BroadPhase broad_phase(config());
    for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(k));
    (void)broad_phase.update();
    for (std::uint32_t b = 0; b < n; ++b) {
      for (std::uint32_t a = 0; a < b; ++a) {
        broad_phase.move(a, apart(b));
        const Delta delta = broad_phase.update();
        ASSERT_EQ(std::vector(delta.added.begin(), delta.added.end()), (std::vector<Pair>{{a, b}}));
        ASSERT_TRUE(delta.removed.empty());
        broad_phase.move(a, apart(a));
        ASSERT_EQ(broad_phase.update().removed.size(), 1U);
      }
    }
  }
}

NOT_IN(gpu_profile | sanitizers, "takes long, and rusticl has this tuning profile");
TEST_P(EachAlgorithm, SizesToAHundredAgreeWithTheOracle) {
  for (std::uint32_t n = 0; n <= 100; ++n) {
    expect_oracle(scenes::MovingBoxes(n, scenes::MovingBoxes::Sizes::mixed, n).boxes(), std::to_string(n));
  }
}

TEST_P(EachAlgorithm, SizesAroundPowersOfTwoAgreeWithTheOracle) {
  for (const std::uint32_t n : {255U, 256U, 257U, 1023U, 1025U, 4097U}) {
    expect_oracle(scenes::MovingBoxes(n, scenes::MovingBoxes::Sizes::mixed).boxes(), std::to_string(n));
  }
}

NOT_IN(gpu_profile | sanitizers, "takes long, and rusticl has this tuning profile");
TEST_P(EachAlgorithm, EveryKindOfSceneAgreesWithTheOracle) {
  for (const std::uint32_t count : {10U, 100U, 500U}) {
    for (const scenes::BoxScene& scene : scenes::box_scenes(count)) {
      expect_oracle(scene.boxes, scene.name + " " + std::to_string(count));
    }
  }
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallEmptyBoxesOverlapNothing) {
  const Aabb all{{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}};
  const Aabb inverted{{0.5F, 0.75F, 0.5F}, {0.5F, 0.25F, 0.5F}};
  EXPECT_EQ(overlapping_pairs(std::vector{all, inverted, unit}, config()), (std::vector<Pair>{{0, 2}}));
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallIdsAreTheLowestFree) {
  BroadPhase broad_phase(config());
  for (std::uint32_t k = 0; k < 10; ++k) EXPECT_EQ(broad_phase.add(unit), k);
  for (const std::uint32_t id : {7U, 2U, 5U}) broad_phase.remove(id);
  EXPECT_EQ(broad_phase.size(), 7U);
  for (const std::uint32_t id : {2U, 5U, 7U, 10U}) EXPECT_EQ(broad_phase.add(unit), id);
}

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_P(EachAlgorithm, SmallARemovedAndReusedIdEndsItsPairs) {
  BroadPhase broad_phase(config());
  for (int k = 0; k < 3; ++k) broad_phase.add(unit);
  (void)broad_phase.update();
  broad_phase.remove(1);
  EXPECT_EQ(broad_phase.add(unit), 1U);
  const Delta delta = broad_phase.update();
  const std::vector<Pair> pairs_of_1{{0, 1}, {1, 2}};
  EXPECT_EQ(std::vector(delta.removed.begin(), delta.removed.end()), pairs_of_1);
  EXPECT_EQ(std::vector(delta.added.begin(), delta.added.end()), pairs_of_1);
}

TEST_P(EachAlgorithm, RemovingTheLastObjectsEndsTheirPairs) {
  BroadPhase broad_phase(config());
  for (int k = 0; k < 40; ++k) broad_phase.add(unit);
  EXPECT_EQ(broad_phase.update().added.size(), 780U);
  for (std::uint32_t id = 1; id < 40; ++id) broad_phase.remove(id);
  EXPECT_EQ(broad_phase.update().removed.size(), 780U);
  for (int k = 0; k < 39; ++k) broad_phase.add(unit);
  EXPECT_EQ(broad_phase.update().added.size(), 780U);
  for (std::uint32_t id = 0; id < 40; ++id) broad_phase.remove(id);
  EXPECT_EQ(broad_phase.update().removed.size(), 780U);
  EXPECT_TRUE(broad_phase.pairs().empty());
}

/// More pairs and more changes than any first guess of buffer sizes; the lists must be whole and in order all
/// the same.
TEST_P(EachAlgorithm, ManyPairsAtOnceAreAllFound) {
  constexpr std::uint32_t n = 700;
  const std::vector<Pair> all = test::all_pairs(n);
  BroadPhase broad_phase(config());
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(k));
  EXPECT_TRUE(broad_phase.update().added.empty());
  for (int round = 0; round < 3; ++round) {
    for (std::uint32_t k = 0; k < n; ++k) broad_phase.move(k, unit);
    Delta delta = broad_phase.update();
    ASSERT_TRUE(std::equal(delta.added.begin(), delta.added.end(), all.begin(), all.end()));
    ASSERT_TRUE(delta.removed.empty());
    ASSERT_EQ(broad_phase.pairs(), all);
    for (std::uint32_t k = 0; k < n; ++k) broad_phase.move(k, apart(k));
    delta = broad_phase.update();
    ASSERT_TRUE(std::equal(delta.removed.begin(), delta.removed.end(), all.begin(), all.end()));
    ASSERT_TRUE(delta.added.empty());
  }
}

TEST_P(EachAlgorithm, BadCallsThrowAndChangeNothing) {
  BroadPhase broad_phase(config());
  broad_phase.add(unit);
  broad_phase.add(unit);
  (void)broad_phase.update();
  EXPECT_THAT(test::error_of([&] { broad_phase.add({{0, nan_value, 0}, {1, 1, 1}}); }), HasSubstr("NaN"));
  EXPECT_THAT(test::error_of([&] { broad_phase.move(1, {{0, 0, 0}, {1, 1, nan_value}}); }), HasSubstr("NaN"));
  EXPECT_THAT(test::error_of([&] { broad_phase.move(2, unit); }), HasSubstr("id 2"));
  EXPECT_THAT(test::error_of([&] { broad_phase.remove(0xffffffff); }), HasSubstr("id 4294967295"));
  EXPECT_EQ(broad_phase.size(), 2U);
  const Delta delta = broad_phase.update();
  EXPECT_TRUE(delta.added.empty() && delta.removed.empty());
  EXPECT_EQ(broad_phase.pairs(), (std::vector<Pair>{{0, 1}}));
  broad_phase.remove(0);
  EXPECT_THAT(test::error_of([&] { broad_phase.remove(0); }), HasSubstr("id 0"));
}

TEST_P(EachAlgorithm, ANaNInAnArrayIsNamed) {
  std::vector<Aabb> boxes(5, unit);
  boxes[3].upper[2] = nan_value;
  EXPECT_THAT(test::error_of([&] { (void)overlapping_pairs(boxes, config()); }), HasSubstr("box 3"));
}

/// Adds, moves and removes at random; after each update the deltas, applied, and the whole list must be the
/// oracle's.
TEST_P(EachAlgorithm, RandomLivesFollowTheOracle) {
  std::mt19937 random(5);
  BroadPhase broad_phase(config());
  BroadPhase oracle({.algorithm = "oracle"});
  std::set<std::uint32_t> live;
  std::set<Pair> pairs;
  const auto uniform = [&](float upper) { return std::uniform_real_distribution<float>(0, upper)(random); };
  const auto random_box = [&]() -> Aabb {
    const float x = uniform(10);
    const float y = uniform(10);
    const float z = uniform(10);
    return {{x, y, z}, {x + uniform(3), y + uniform(3), z + uniform(3)}};
  };
  for (int frame = 0; frame < 60; ++frame) {
    const float death = frame % 20 == 19 ? 1.0F : 0.1F;
    for (const std::uint32_t id : std::set(live)) {
      const float fate = uniform(1);
      if (fate < death) {
        broad_phase.remove(id);
        oracle.remove(id);
        live.erase(id);
      } else if (fate < 0.7F) {
        const Aabb box = random_box();
        broad_phase.move(id, box);
        oracle.move(id, box);
      }
    }
    for (int k = 0; k < 15; ++k) {
      const Aabb box = random_box();
      const std::uint32_t id = broad_phase.add(box);
      ASSERT_EQ(id, oracle.add(box));
      live.insert(id);
    }
    const Delta delta = broad_phase.update();
    const Delta expected = oracle.update();
    ASSERT_TRUE(
        std::equal(delta.added.begin(), delta.added.end(), expected.added.begin(), expected.added.end()));
    ASSERT_TRUE(std::equal(delta.removed.begin(), delta.removed.end(), expected.removed.begin(),
                           expected.removed.end()));
    for (const Pair& pair : delta.removed) ASSERT_EQ(pairs.erase(pair), 1U);
    for (const Pair& pair : delta.added) ASSERT_TRUE(pairs.insert(pair).second);
    const std::vector<Pair> all = broad_phase.pairs();
    ASSERT_TRUE(std::equal(all.begin(), all.end(), pairs.begin(), pairs.end()));
  }
}

TEST_P(EachAlgorithm, TwoObjectsDoNotDisturbEachOther) {
  BroadPhase one(config());
  BroadPhase other(config());
  one.add(unit);
  one.add(unit);
  other.add(unit);
  EXPECT_EQ(one.update().added.size(), 1U);
  EXPECT_TRUE(other.update().added.empty());
  BroadPhase moved = std::move(one);
  EXPECT_TRUE(moved.update().added.empty());
  EXPECT_EQ(moved.pairs().size(), 1U);
}

TEST_P(EachAlgorithm, TellsWhatItRunsOn) {
  const BroadPhase broad_phase(config());
  EXPECT_EQ(broad_phase.algorithm().name, GetParam().name);
  EXPECT_EQ(broad_phase.device() != nullptr, GetParam().on_device);
}

TEST(Algorithms, AnUnknownOneIsAnErrorThatListsThem) {
  const std::string text = test::error_of([] { BroadPhase({.algorithm = "magic"}); });
  for (const AlgorithmInfo& info : algorithms()) EXPECT_THAT(text, HasSubstr(std::string(info.name)));
}

ALSO_IN(gpu_profile | rusticl);
TEST(GpuBf, ReportsItsStages) {
  BroadPhase broad_phase({.algorithm = "gpu-bf", .profile = true});
  for (int k = 0; k < 100; ++k) broad_phase.add(unit);
  (void)broad_phase.update();
  std::vector<std::string_view> names;
  for (const Stage& stage : broad_phase.profile()) {
    names.push_back(stage.name);
    EXPECT_GT(stage.host_seconds, 0) << stage.name;
    if (stage.name == "test") {
      EXPECT_GT(stage.device_seconds, 0);
    }
  }
  EXPECT_EQ(names, (std::vector<std::string_view>{"upload", "test", "download", "wait", "xor"}));
}

/// Too many boxes for one byte a pair: an error with the numbers, after which fewer boxes work as before.
TEST(GpuBf, BeyondTheLargestAllocationIsAnErrorAndStateIsKept) {
  BroadPhase broad_phase({.algorithm = "gpu-bf"});
  const std::uint64_t limit = broad_phase.device()->max_allocation;
  broad_phase.add(unit);
  broad_phase.add(unit);
  (void)broad_phase.update();
  std::uint64_t n = 2;
  while (n * (n - 1) / 2 <= limit) n += n / 2;
  for (std::uint64_t k = 2; k < n; ++k) broad_phase.add(apart(static_cast<std::uint32_t>(k)));
  const std::string text = test::error_of([&] { (void)broad_phase.update(); });
  EXPECT_THAT(text, HasSubstr(std::to_string(limit)));
  EXPECT_THAT(text, HasSubstr(std::to_string(n) + " boxes"));
  EXPECT_THAT(text, HasSubstr("another algorithm"));
  EXPECT_EQ(broad_phase.pairs(), (std::vector<Pair>{{0, 1}}));
  for (std::uint64_t k = 2; k < n; ++k) broad_phase.remove(static_cast<std::uint32_t>(k));
  EXPECT_EQ(broad_phase.add(unit), 2U);
  EXPECT_EQ(broad_phase.update().added.size(), 2U);
}

/// Stages are named, and a frame in the steady state waits for the device once.
TEST(BruteForce, WaitsOncePerFrame) {
  BroadPhase broad_phase({.algorithm = "brute-force", .profile = true});
  scenes::MovingBoxes boxes(1000, scenes::MovingBoxes::Sizes::uniform);
  for (const Aabb& box : boxes.boxes()) broad_phase.add(box);
  (void)broad_phase.update();
  for (int frame = 0; frame < 5; ++frame) {
    boxes.advance();
    for (std::uint32_t id = 0; id < 1000; ++id) broad_phase.move(id, boxes.boxes()[id]);
    (void)broad_phase.update();
  }
  std::vector<std::string_view> names;
  for (const Stage& stage : broad_phase.profile()) names.push_back(stage.name);
  EXPECT_EQ(names, (std::vector<std::string_view>{"upload", "keep", "test", "order", "download", "wait"}));
}

/// The index of the last rows is past 32 bits; 4.3 GB a frame. With --long only.
TEST(Long, GpuBfFindsPairsWhoseIndexIsPast32Bits) {
  constexpr std::uint32_t n = 92'700;
  if (select_device().max_allocation < 4'400'000'000U)
    GTEST_SKIP() << "the device allocates less than 4.4 GB at once";
  BroadPhase broad_phase({.algorithm = "gpu-bf"});
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(k));
  const std::set<std::uint32_t> members{0, 1, 46'341, 92'681, 92'682, 92'683, 92'684, 92'690, 92'698, 92'699};
  for (const std::uint32_t id : members) broad_phase.move(id, unit);
  std::vector<Pair> expected;
  for (const std::uint32_t b : members) {
    for (const std::uint32_t a : members) {
      if (a < b) expected.push_back({a, b});
    }
  }
  const Delta delta = broad_phase.update();
  EXPECT_EQ(std::vector(delta.added.begin(), delta.added.end()), expected);
}

}  // namespace
}  // namespace broadcl
