#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <limits>
#include <set>

#include <gtest/gtest.h>

#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

SUITE_ALSO_IN(BruteForce, gpu_profile | rusticl);

using test::apart;
using test::EachAlgorithm;
using test::nan_value;
using test::unit;
using ::testing::HasSubstr;

/// The other algorithms are compared with the oracle; search_test.cpp compares it with the definitions.
std::vector<AlgorithmInfo> algorithms_but_the_oracle() {
  std::vector<AlgorithmInfo> rows(algorithms().begin(), algorithms().end());
  std::erase_if(rows, [](const AlgorithmInfo& row) { return row.name == "oracle"; });
  return rows;
}

// One instantiation for all files: gtest collects the tests of a suite from all of them.
INSTANTIATE_TEST_SUITE_P(Table, EachAlgorithm, ::testing::ValuesIn(algorithms_but_the_oracle()),
                         test::named_by_parameter);
using test::LongEachAlgorithm;
INSTANTIATE_TEST_SUITE_P(Long, LongEachAlgorithm, ::testing::ValuesIn(algorithms_but_the_oracle()),
                         test::named_by_parameter);
using test::EachDeviceAlgorithm;
INSTANTIATE_TEST_SUITE_P(Table, EachDeviceAlgorithm, ::testing::ValuesIn(test::device_algorithms()),
                         test::named_by_parameter);

TEST_P(EachAlgorithm, EveryPairIsFoundAlone) {
  for (const std::uint32_t n : {2U, 7U, 19U}) {
    BroadPhase broad_phase(config());
    for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(k));
    (void)broad_phase.update();
    for (std::uint32_t b = 0; b < n; ++b) {
      for (std::uint32_t a = 0; a < b; ++a) {
        broad_phase.move(a, apart(b));
        ASSERT_TRUE(test::same(broad_phase.update(), std::vector<Pair>{{a, b}}, {}));
        broad_phase.move(a, apart(a));
        ASSERT_EQ(broad_phase.update().removed.size(), 1U);
      }
    }
  }
}

/// All small sizes, and those next to multiples of the number of boxes that kernels process at once.
NOT_IN(gpu_profile | sanitizers, "takes long, and rusticl has this tuning");
TEST_P(EachAlgorithm, SizesToAHundredAgreeWithTheOracle) {
  for (std::uint32_t n = 0; n <= 100; ++n) {
    if (n > 20 && (n + 1) % 16 > 2) continue;
    expect_oracle(scenes::MovingBoxes(n, scenes::MovingBoxes::Sizes::mixed, n).boxes(), std::to_string(n));
  }
}

/// With any tuning, there is room for fewer at first.
TEST_P(EachAlgorithm, OnlySearchesFindMorePairsThanWereExpected) {
  constexpr std::uint32_t n = 600;
  EXPECT_TRUE(test::same("all at one place", overlapping_pairs(std::vector<Aabb>(n, unit), {}, config()),
                         test::all_pairs(n)));
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallIdsAreTheLowestFree) {
  BroadPhase broad_phase(config());
  for (std::uint32_t k = 0; k < 10; ++k) EXPECT_EQ(broad_phase.add(unit), k);
  for (const std::uint32_t id : {7U, 2U, 5U}) broad_phase.remove(id);
  EXPECT_EQ(broad_phase.size(), 7U);
  for (const std::uint32_t id : {2U, 5U, 7U, 10U}) EXPECT_EQ(broad_phase.add(unit), id);
}

TEST_P(EachAlgorithm, BadCallsThrowAndChangeNothing) {
  BroadPhase broad_phase(config());
  broad_phase.add(unit);
  broad_phase.add(unit);
  (void)broad_phase.update();
  EXPECT_THAT(test::error_of([&] { broad_phase.add({{0, nan_value, 0}, {1, 1, 1}}); }), HasSubstr("NaN"));
  EXPECT_THAT(test::error_of([&] { broad_phase.move(1, {{0, 0, 0}, {1, 1, nan_value}}); }), HasSubstr("NaN"));
  EXPECT_THAT(test::error_of([&] { broad_phase.move(2, unit); }), HasSubstr("id 2"));
  EXPECT_THAT(test::error_of([&] { broad_phase.set_filter(2, {.mask = 0}); }), HasSubstr("id 2"));
  EXPECT_THAT(test::error_of([&] { broad_phase.remove(0xffffffff); }), HasSubstr("id 4294967295"));
  EXPECT_EQ(broad_phase.size(), 2U);
  const Delta delta = broad_phase.update();
  EXPECT_TRUE(delta.added.empty() && delta.removed.empty());
  EXPECT_EQ(broad_phase.pairs(), (std::vector<Pair>{{0, 1}}));
  broad_phase.remove(0);
  EXPECT_THAT(test::error_of([&] { broad_phase.remove(0); }), HasSubstr("id 0"));
  EXPECT_THAT(test::error_of([&] { broad_phase.set_filter(0, {.mask = 0}); }), HasSubstr("id 0"));
  EXPECT_EQ(broad_phase.add(unit), 0U);
  EXPECT_TRUE(test::same(broad_phase.update(), std::vector<Pair>{{0, 1}}, std::vector<Pair>{{0, 1}}));
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

TEST_P(EachAlgorithm, ReportsWhatItRunsOn) {
  const BroadPhase broad_phase(config());
  EXPECT_EQ(broad_phase.algorithm().name, GetParam().name);
  if (GetParam().name == "auto") return;  // it runs on either
  EXPECT_EQ(broad_phase.device() != nullptr, GetParam().on_device);
}

TEST(Algorithms, AnUnknownOneIsAnErrorThatListsThem) {
  const std::string text = test::error_of([] { BroadPhase({.algorithm = "magic"}); });
  for (const AlgorithmInfo& info : algorithms()) EXPECT_THAT(text, HasSubstr(std::string(info.name)));
}

/// One byte per pair exceeds the largest allocation: an error with the numbers. Afterwards fewer boxes work
/// as before.
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

/// The indices of the last rows are past 32 bits; 4.3 GB per frame. Only with --long.
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
