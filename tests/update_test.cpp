#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "scenes/generators.hpp"

/// What an update costs and what it tells: few moved, begin() and finish(), map().
namespace broadcl {
namespace {

using test::apart;
using test::EachAlgorithm;
using test::same;
using test::unit;
using ::testing::AllOf;
using ::testing::HasSubstr;

using Pairs = std::vector<Pair>;

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();
constexpr Aabb inverted{{1, 0, 0}, {0, 1, 1}};

std::vector<std::string_view> stages(const BroadPhase& broad_phase) {
  std::vector<std::string_view> names;
  for (const Stage& stage : broad_phase.profile()) names.push_back(stage.name);
  return names;
}

// Cost follows movement.

TEST_P(EachAlgorithm, SmallWhereNothingMovedTheDeviceIsNotAsked) {
  BroadPhase broad_phase(config());
  EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  EXPECT_TRUE(broad_phase.profile().empty());
  for (std::uint32_t k = 0; k < 10; ++k) broad_phase.add(unit, {.body = k});
  broad_phase.add(inverted);
  const auto expect_work = [&](bool expected) {
    EXPECT_EQ(!broad_phase.profile().empty(), expected && GetParam().on_device);
  };
  EXPECT_EQ(broad_phase.update().added.size(), 45U);
  expect_work(true);
  EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  expect_work(false);

  // None of these changes anything.
  broad_phase.move(3, unit);
  broad_phase.set_filter(3, {.body = 3});
  broad_phase.move(10, {{0, 5, 0}, {1, 4, 1}});
  broad_phase.move(4, apart(9));
  broad_phase.move(4, unit);
  broad_phase.begin();
  EXPECT_TRUE(same(broad_phase.finish(), {}, {}));
  // The box went away and came back: it may count, but nothing came of it.
  broad_phase.move(3, unit);
  EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  expect_work(false);

  broad_phase.move(10, unit);
  EXPECT_EQ(broad_phase.update().added.size(), 10U);
  expect_work(true);
  EXPECT_EQ(broad_phase.pairs().size(), 55U);
}

/// Few moved: they are applied, and pairs of the others carried; many: all boxes are uploaded and tested. One
/// wait an update.
TEST(BruteForce, AppliesAndCarriesWhereFewMoved) {
  using Names = std::vector<std::string_view>;
  BroadPhase broad_phase({.algorithm = "brute-force", .profile = true});
  for (std::uint32_t k = 0; k < 200; ++k) broad_phase.add(apart(k / 2));
  EXPECT_EQ(broad_phase.update().added.size(), 100U);
  for (std::uint32_t moved : {1U, 50U}) {
    for (std::uint32_t id = 0; id < moved; ++id) broad_phase.move(id, apart(id / 2 + 1000 * moved));
    (void)broad_phase.update();
    EXPECT_EQ(stages(broad_phase),
              (Names{"upload", "apply", "test", "carry", "sweep", "order", "download", "wait"}))
        << moved;
  }
  for (std::uint32_t id = 0; id < 51; ++id) broad_phase.move(id, apart(id / 2 + 5000));
  (void)broad_phase.update();
  EXPECT_EQ(stages(broad_phase), (Names{"upload", "test", "sweep", "order", "download", "wait"}));
}

TEST_P(EachAlgorithm, SmallPairsOfTwoThatStandStillStay) {
  BroadPhase broad_phase(config());
  for (std::uint32_t k = 0; k < 64; ++k) broad_phase.add(apart(k / 2));
  EXPECT_EQ(broad_phase.update().added.size(), 32U);
  // Every object visits every place, alone.
  for (std::uint32_t id = 0; id < 64; id += 21) {
    const std::uint32_t partner = id ^ 1U;
    const Pairs own{{std::min(id, partner), std::max(id, partner)}};
    for (std::uint32_t place = 0; place < 32; place += 13) {
      if (place == id / 2) continue;
      Pairs there;
      for (const std::uint32_t other : {2 * place, 2 * place + 1}) {
        there.push_back({std::min(id, other), std::max(id, other)});
      }
      broad_phase.move(id, apart(place));
      ASSERT_TRUE(same(broad_phase.update(), there, own)) << id << " to " << place;
      ASSERT_EQ(broad_phase.pairs().size(), 33U);
      broad_phase.move(id, apart(id / 2));
      ASSERT_TRUE(same(broad_phase.update(), own, there));
    }
  }
}

/// Moves the first, or random, m of n boxes; what the deltas make of the pairs must be what a new search of
/// the same boxes finds.
void follow_fresh_searches(const BroadPhase::Config& config, std::uint32_t n, std::uint32_t seed) {
  std::mt19937 random(seed);
  scenes::MovingBoxes moving(n, scenes::MovingBoxes::Sizes::mixed, seed);
  std::vector<Aabb> boxes(moving.boxes().begin(), moving.boxes().end());
  BroadPhase broad_phase(config);
  for (const Aabb& box : boxes) broad_phase.add(box);
  std::vector<Pair> pairs;
  const auto follow = [&](std::uint32_t moved) {
    const Delta delta = broad_phase.update();
    std::vector<Pair> kept;
    std::vector<Pair> now;
    std::set_difference(pairs.begin(), pairs.end(), delta.removed.begin(), delta.removed.end(),
                        std::back_inserter(kept));
    ASSERT_EQ(kept.size() + delta.removed.size(), pairs.size());
    std::set_union(kept.begin(), kept.end(), delta.added.begin(), delta.added.end(), std::back_inserter(now));
    ASSERT_EQ(now.size(), kept.size() + delta.added.size());
    pairs = std::move(now);
    const std::vector<Pair> fresh = overlapping_pairs(boxes, config);
    ASSERT_TRUE(same("by deltas", pairs, fresh)) << moved << " of " << n << ", seed " << seed;
    ASSERT_TRUE(same("pairs()", broad_phase.pairs(), fresh)) << moved << " of " << n << ", seed " << seed;
  };
  follow(n);
  std::vector<std::uint32_t> ids(n);
  std::iota(ids.begin(), ids.end(), 0);
  for (const std::uint32_t m : {1U, 2U, n / 8, n / 4, n / 4 + 1, n - 1, n, 1U, n / 4, n}) {
    std::shuffle(ids.begin(), ids.end(), random);
    for (int step = 0; step < 10; ++step) moving.advance();
    for (std::uint32_t k = 0; k < std::min(m, n); ++k) {
      boxes[ids[k]] = moving.boxes()[ids[k]];
      if (random() % 16 == 0) boxes[ids[k]] = inverted;
      broad_phase.move(ids[k], boxes[ids[k]]);
    }
    follow(m);
    if (::testing::Test::HasFatalFailure()) return;
  }
}

TEST_P(EachAlgorithm, SmallFewMovedFindWhatANewSearchFinds) {
  for (const std::uint32_t n : {3U, 18U}) {
    follow_fresh_searches(config(), n, n);
    if (HasFatalFailure()) return;
  }
}

TEST_P(EachAlgorithm, FewMovedFindWhatANewSearchFinds) {
  for (const std::uint32_t n : {2U, 4U, 5U, 8U, 16U, 17U, 31U, 32U, 33U, 40U, 255U, 256U, 257U, 4097U}) {
    if (n > 1000 && is_slow()) continue;
    follow_fresh_searches(config(), n, n);
    if (HasFatalFailure()) return;
  }
}

/// Room for 256, 384, ... boxes: a new object makes the boxes lie elsewhere, and those that stand still must
/// come along.
TEST_P(EachAlgorithm, BoxesThatStandStillComeAlongWhenMemoryGrows) {
  test::Twins twins(config());
  for (std::uint32_t k = 0; k < 256; ++k) twins.add(apart(k), {.body = k});
  ASSERT_TRUE(twins.agree());
  for (std::uint32_t id = 256; id < 600; ++id) {
    twins.add(apart(id / 2));
    if (id % 64 < 2) {
      ASSERT_TRUE(twins.agree()) << id;
    }
  }
  ASSERT_TRUE(twins.agree());
  EXPECT_EQ(twins.tested().pairs().size(), 428U);
}

TEST_P(EachAlgorithm, SmallTheLastOrAllRemovedAndAddedAgain) {
  test::Twins twins(config());
  for (std::uint32_t k = 0; k < 20; ++k) twins.add(k % 2 == 0 ? unit : apart(k / 2));
  ASSERT_TRUE(twins.agree());
  for (const std::uint32_t removed : {1U, 6U, 20U}) {
    for (std::uint32_t id = 20 - removed; id < 20; ++id) twins.remove(id);
    ASSERT_TRUE(twins.agree()) << removed;
    for (std::uint32_t k = 0; k < removed; ++k) twins.add(k % 3 == 0 ? unit : apart(k));
    ASSERT_TRUE(twins.agree()) << removed;
    // And in one update.
    for (std::uint32_t id = 20 - removed; id < 20; ++id) twins.remove(id);
    for (std::uint32_t k = 0; k + 1 < removed; ++k) twins.add(unit);
    ASSERT_TRUE(twins.agree()) << removed;
    twins.add(unit);
    ASSERT_TRUE(twins.agree()) << removed;
  }
}

TEST_P(EachAlgorithm, SmallSignedZerosAndEmptyBoxesThatMove) {
  test::Twins twins(config());
  const Aabb positive{{0, 0, 0}, {1, 1, 0}};
  const Aabb negative{{-0.0F, -0.0F, -0.0F}, {1, 1, -0.0F}};
  for (int k = 0; k < 9; ++k) twins.add(k % 2 == 0 ? positive : negative);
  ASSERT_TRUE(twins.agree());
  EXPECT_EQ(twins.tested().pairs().size(), 36U);
  for (std::uint32_t id = 0; id < 3; ++id) {
    twins.move(id, id % 2 == 0 ? negative : positive);
    ASSERT_TRUE(twins.agree());
    EXPECT_EQ(twins.tested().pairs().size(), 36U);
  }
  for (std::uint32_t id = 0; id < 3; ++id) {
    twins.move(id, inverted);
    ASSERT_TRUE(twins.agree());
    EXPECT_EQ(twins.tested().pairs().size(), 28U);
    twins.move(id, {{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}});
    ASSERT_TRUE(twins.agree());
    twins.move(id, negative);
    ASSERT_TRUE(twins.agree());
    EXPECT_EQ(twins.tested().pairs().size(), 36U);
  }
}

// begin() and finish().

TEST_P(EachAlgorithm, SmallFinishTellsWhatBeganAndWhatCameAfter) {
  BroadPhase broad_phase(config());
  for (std::uint32_t k = 0; k < 20; ++k) broad_phase.add(apart(k));
  broad_phase.move(1, apart(0));
  EXPECT_TRUE(same(broad_phase.finish(), Pairs{{0, 1}}, {})) << "without begin()";

  broad_phase.move(3, apart(2));
  broad_phase.begin();
  broad_phase.begin();
  EXPECT_TRUE(same(broad_phase.finish(), Pairs{{2, 3}}, {}));

  broad_phase.move(5, apart(4));
  broad_phase.begin();
  broad_phase.move(7, apart(6));
  broad_phase.begin();  // nothing: the first is not over
  EXPECT_TRUE(same(broad_phase.update(), Pairs{{4, 5}, {6, 7}}, {})) << "update() instead";

  broad_phase.begin();
  EXPECT_TRUE(same(broad_phase.finish(), {}, {})) << "nothing moved";
  broad_phase.begin();
  broad_phase.move(9, apart(8));
  EXPECT_TRUE(same(broad_phase.finish(), Pairs{{8, 9}}, {})) << "nothing had moved when it began";
  EXPECT_EQ(broad_phase.pairs(), (Pairs{{0, 1}, {2, 3}, {4, 5}, {6, 7}, {8, 9}}));
}

TEST_P(EachAlgorithm, SmallPairsThatBeganAndEndedInFlightAreNoChange) {
  BroadPhase broad_phase(config());
  for (std::uint32_t k = 0; k < 20; ++k) broad_phase.add(apart(k / 2));
  (void)broad_phase.update();
  // Met in the search that was begun, apart when it ends.
  broad_phase.move(3, apart(0));
  broad_phase.begin();
  broad_phase.move(3, apart(1));
  EXPECT_TRUE(same(broad_phase.finish(), {}, {}));
  // And the other way round.
  broad_phase.move(3, apart(50));
  broad_phase.begin();
  broad_phase.move(3, apart(1));
  EXPECT_TRUE(same(broad_phase.finish(), {}, {}));
  // There and back in flight.
  broad_phase.move(5, apart(60));
  broad_phase.begin();
  broad_phase.move(3, apart(50));
  broad_phase.move(3, apart(1));
  EXPECT_TRUE(same(broad_phase.finish(), {}, Pairs{{4, 5}}));
  broad_phase.begin();
  const auto filter = Filter{.mask = 0};
  broad_phase.move(5, apart(2));
  broad_phase.begin();
  broad_phase.set_filter(4, filter);
  EXPECT_TRUE(same(broad_phase.finish(), {}, {}));
  EXPECT_EQ(broad_phase.pairs().size(), 9U);
}

TEST_P(EachAlgorithm, SmallObjectsRenewedInFlightAreOthers) {
  BroadPhase broad_phase(config());
  for (std::uint32_t k = 0; k < 20; ++k) broad_phase.add(apart(k / 2));
  (void)broad_phase.update();
  const Pairs pair{{2, 3}};
  // Another object with the same id, whose pair is another one: in flight, before, and both.
  broad_phase.move(19, apart(30));
  broad_phase.begin();
  broad_phase.remove(3);
  EXPECT_EQ(broad_phase.add(apart(1)), 3U);
  EXPECT_TRUE(same(broad_phase.finish(), pair, Pairs{{2, 3}, {18, 19}}));
  broad_phase.remove(3);
  EXPECT_EQ(broad_phase.add(apart(1)), 3U);
  broad_phase.begin();
  broad_phase.move(19, apart(9));
  EXPECT_TRUE(same(broad_phase.finish(), Pairs{{2, 3}, {18, 19}}, pair));
  broad_phase.remove(3);
  EXPECT_EQ(broad_phase.add(apart(1)), 3U);
  broad_phase.begin();
  broad_phase.remove(3);
  EXPECT_EQ(broad_phase.add(apart(1)), 3U);
  EXPECT_TRUE(same(broad_phase.finish(), pair, pair));
  // It met another in the search that was begun, of which nobody was told.
  broad_phase.move(3, apart(40));
  EXPECT_TRUE(same(broad_phase.update(), {}, pair));
  broad_phase.move(3, apart(1));
  broad_phase.begin();
  broad_phase.remove(3);
  EXPECT_TRUE(same(broad_phase.finish(), {}, {}));
  broad_phase.begin();
  EXPECT_EQ(broad_phase.add(apart(1)), 3U);
  broad_phase.remove(3);
  EXPECT_TRUE(same(broad_phase.finish(), {}, {}));
  EXPECT_EQ(broad_phase.size(), 19U);
}

TEST_P(EachAlgorithm, SmallBadCallsInFlightAreErrorsAndChangeNothing) {
  BroadPhase broad_phase(config());
  for (int k = 0; k < 3; ++k) broad_phase.add(unit);
  broad_phase.begin();
  EXPECT_THAT(test::error_of([&] { (void)broad_phase.pairs(); }),
              AllOf(HasSubstr("pairs()"), HasSubstr("call finish()")));
  EXPECT_THAT(test::error_of([&] { (void)broad_phase.map(2); }),
              AllOf(HasSubstr("map()"), HasSubstr("call finish()")));
  EXPECT_THAT(test::error_of([&] { broad_phase.move(3, unit); }), HasSubstr("id 3"));
  EXPECT_THAT(test::error_of([&] { broad_phase.remove(3); }), HasSubstr("id 3"));
  EXPECT_THAT(test::error_of([&] { broad_phase.set_filter(3, {}); }), HasSubstr("id 3"));
  EXPECT_THAT(test::error_of([&] { broad_phase.move(0, {{nan_value, 0, 0}, {1, 1, 1}}); }), HasSubstr("NaN"));
  EXPECT_THAT(test::error_of([&] { broad_phase.add({{nan_value, 0, 0}, {1, 1, 1}}); }), HasSubstr("NaN"));
  EXPECT_EQ(broad_phase.size(), 3U);
  EXPECT_TRUE(same(broad_phase.finish(), test::all_pairs(3), {}));
  EXPECT_EQ(broad_phase.pairs(), test::all_pairs(3));
  EXPECT_EQ(broad_phase.map(2).size(), 2U);
}

TEST_P(EachAlgorithm, SmallOneInFlightMayBeMovedAndDestroyed) {
  BroadPhase one(config());
  for (int k = 0; k < 20; ++k) one.add(unit);
  {
    BroadPhase other(config());
    for (int k = 0; k < 20; ++k) other.add(unit);
    other.begin();
  }
  one.begin();
  BroadPhase moved = std::move(one);
  moved.remove(19);
  EXPECT_TRUE(same(moved.finish(), test::all_pairs(19), {}));
}

/// Thousands come while a search runs over a few; and pairs that were found by the search that was begun end.
TEST_P(EachAlgorithm, MemoryGrowsForWhatIsAddedInFlight) {
  const std::uint32_t n = is_slow() ? 1000 : 5000;
  test::Twins twins(config());
  for (int k = 0; k < 30; ++k) twins.add(unit);
  twins.begin();
  for (std::uint32_t k = 0; k < n; ++k) twins.add(apart(k / 2), {.body = k / 8});
  twins.set_filter(7, {.world = 1});
  twins.remove(8);
  for (std::uint32_t id = 20; id < 30; ++id) twins.move(id, apart(id));
  ASSERT_TRUE(twins.agree());
  twins.move(9, apart(9));
  twins.begin();
  for (std::uint32_t id = 30; id < n + 30; ++id) twins.remove(id);
  ASSERT_TRUE(twins.agree());
  twins.begin();
  EXPECT_EQ(twins.add(unit), 8U);
  ASSERT_TRUE(twins.agree());
}

/// Random operations before and after begin(); the oracle is updated once, when finish() is called.
void operate_at_random(const BroadPhase::Config& config, std::uint32_t seeds, int frames) {
  for (std::uint32_t seed = 1; seed <= seeds; ++seed) {
    std::mt19937 random(seed);
    const auto below = [&](std::size_t n) { return static_cast<std::uint32_t>(random() % n); };
    test::Twins twins(config);
    std::vector<std::uint32_t> live;
    std::vector<Aabb> homes(64, inverted);
    const auto operate = [&](std::uint32_t count) {
      for (std::uint32_t k = 0; k < count; ++k) {
        const std::uint32_t which = below(10);
        const Aabb box = apart(below(6));
        if (live.empty() || (which < 3 && live.size() < homes.size())) {
          const std::uint32_t id = twins.add(box, {.body = below(3) == 0 ? below(4) : Filter::no_body});
          live.push_back(id);
          homes[id] = box;
          continue;
        }
        const std::uint32_t place = below(live.size());
        const std::uint32_t id = live[place];
        if (which < 5) {
          twins.move(id, box);
        } else if (which < 7) {
          twins.move(id, homes[id]);
        } else if (which == 7) {
          twins.set_filter(id,
                           {.mask = below(4) == 0 ? 0 : 0xffffffff, .world = seed % 2 == 1 ? below(2) : 0});
        } else {
          twins.remove(id);
          live.erase(live.begin() + place);
        }
      }
    };
    operate(60);
    for (int frame = 0; frame < frames; ++frame) {
      operate(below(2) * below(12));
      for (std::uint32_t k = below(3); k > 0; --k) twins.begin();
      operate(below(3) * below(6));
      ASSERT_TRUE(twins.agree()) << "seed " << seed << ", frame " << frame;
    }
  }
}

TEST_P(EachAlgorithm, SmallRandomOperationsInFlightAreThoseOfOneUpdate) {
  operate_at_random(config(), 1, 15);
}

TEST_P(EachAlgorithm, RandomOperationsInFlightAreThoseOfOneUpdate) {
  operate_at_random(config(), 12, 40);
}

/// More pairs than the device has memory for: finish() is an error that says so, after which everything that
/// was done before and in flight is there, and the next update has the right changes.
TEST(BruteForce, ExhaustedMemoryInFlightLosesNothing) {
  constexpr std::uint32_t few = 20;
  BroadPhase broad_phase;
  const std::uint64_t limit = broad_phase.device()->max_allocation;
  // The list of pairs alone takes 8 bytes a pair.
  const auto n = static_cast<std::uint32_t>(std::sqrt(static_cast<double>(limit) / 4)) + 2;
  if (n > 30'000) GTEST_SKIP() << "the device allocates more than 3.6 GB at once";
  if (broad_phase.device()->platform_name.find("rusticl") != std::string::npos)
    GTEST_SKIP() << "takes minutes";
  for (std::uint32_t k = 0; k < few; ++k) broad_phase.add(apart(k / 2));
  EXPECT_EQ(broad_phase.update().added.size(), few / 2);
  const Pairs before = broad_phase.pairs();

  for (std::uint32_t id = few; id < n; ++id) broad_phase.add({{-9, 0, 0}, {-8, 1, 1}});
  broad_phase.begin();
  broad_phase.move(1, apart(1));
  const std::uint32_t late = broad_phase.add(apart(2));
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(100'000));  // more than there is room for
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.remove(late + n - k);
  EXPECT_THAT(test::error_of([&] { (void)broad_phase.finish(); }),
              AllOf(HasSubstr(std::to_string(limit)), HasSubstr("fewer boxes")));
  EXPECT_EQ(broad_phase.pairs(), before);
  EXPECT_EQ(broad_phase.size(), n + 1);

  // What is done now comes after what was done in flight.
  broad_phase.move(1, apart(3));
  broad_phase.move(late, apart(4));
  for (std::uint32_t id = few; id < n; ++id) broad_phase.remove(id);
  EXPECT_TRUE(same(broad_phase.update(), Pairs{{1, 6}, {1, 7}, {8, late}, {9, late}}, Pairs{{0, 1}}));
}

// map().

TEST_P(EachAlgorithm, SmallMappedBoxesAreThoseOfTheObjects) {
  BroadPhase broad_phase(config());
  const std::span<Aabb> boxes = broad_phase.map(40);
  EXPECT_EQ(boxes.size(), 40U);
  EXPECT_EQ(broad_phase.size(), 40U);
  for (std::uint32_t k = 0; k < 40; ++k) boxes[k] = apart(k / 2);
  EXPECT_EQ(broad_phase.update().added.size(), 20U);
  const std::span<Aabb> again = broad_phase.map(40);
  for (std::uint32_t k = 0; k < 40; ++k) ASSERT_EQ(again[k], apart(k / 2));
  EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  again[0] = apart(1);
  EXPECT_TRUE(same(broad_phase.update(), {}, {})) << "not mapped any more";
}

TEST_P(EachAlgorithm, SmallNewObjectsOfAMapAreEmpty) {
  BroadPhase broad_phase(config());
  for (const std::size_t n : {std::size_t{3}, std::size_t{50}, std::size_t{500}}) {
    const std::span<Aabb> boxes = broad_phase.map(n);
    for (const Aabb& box : boxes) ASSERT_TRUE(is_empty(box) && !has_nan(box)) << n;
    EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  }
  // Slots that others left behind.
  for (Aabb& box : broad_phase.map(30)) box = unit;
  EXPECT_EQ(broad_phase.update().added.size(), 30U * 29 / 2);
  (void)broad_phase.map(10);
  const std::span<Aabb> boxes = broad_phase.map(40);
  for (std::size_t k = 10; k < 40; ++k) ASSERT_TRUE(is_empty(boxes[k]) && !has_nan(boxes[k])) << k;
  EXPECT_EQ(broad_phase.update().removed.size(), 30U * 29 / 2 - 45);
}

TEST_P(EachAlgorithm, SmallMapGrowsAndShrinks) {
  test::Twins twins(config());
  for (const std::size_t n : {5U, 40U, 39U, 7U, 1U, 0U, 33U, 0U, 0U, 2U}) {
    twins.map(n, [](std::span<Aabb> boxes) {
      for (std::size_t k = 0; k < boxes.size(); ++k) boxes[k] = apart(k % 17);
    });
    ASSERT_TRUE(twins.agree()) << n;
    ASSERT_EQ(twins.tested().size(), n);
  }
  twins.map(20, [](std::span<Aabb> boxes) { std::fill(boxes.begin(), boxes.end(), unit); });
  twins.map(10, [](std::span<Aabb> boxes) { boxes[3] = inverted; });
  ASSERT_TRUE(twins.agree());
  EXPECT_EQ(twins.tested().pairs().size(), 36U);  // of 10 boxes, less one
}

TEST_P(EachAlgorithm, SmallANaNInAMapIsNamedAndMended) {
  BroadPhase broad_phase(config());
  for (int k = 0; k < 3; ++k) broad_phase.add(unit);
  (void)broad_phase.update();
  const std::span<Aabb> boxes = broad_phase.map(40);
  for (std::uint32_t k = 0; k < 40; ++k) boxes[k] = apart(k / 2);
  boxes[31].lower[1] = nan_value;
  boxes[17].upper[2] = nan_value;
  for (int time = 0; time < 2; ++time) {
    EXPECT_THAT(test::error_of([&] { (void)broad_phase.update(); }), HasSubstr("box 17 "));
    EXPECT_THAT(test::error_of([&] { broad_phase.begin(); }), HasSubstr("box 17 "));
  }
  EXPECT_EQ(broad_phase.pairs(), test::all_pairs(3));
  EXPECT_EQ(broad_phase.size(), 40U);
  boxes[17] = apart(8);
  EXPECT_THAT(test::error_of([&] { (void)broad_phase.finish(); }), HasSubstr("box 31 "));
  // One that is still bad does not become an empty one by being mapped again.
  (void)broad_phase.map(40);
  EXPECT_THAT(test::error_of([&] { (void)broad_phase.update(); }), HasSubstr("box 31 "));
  broad_phase.move(31, apart(15));
  const Delta delta = broad_phase.update();
  EXPECT_EQ(delta.added.size(), 19U);
  EXPECT_TRUE(same("removed", delta.removed, Pairs{{0, 2}, {1, 2}}));
}

TEST_P(EachAlgorithm, SmallEmptyMappedBoxesComeAndGo) {
  test::Twins twins(config());
  for (const std::size_t step : {1U, 2U, 3U, 7U}) {
    twins.map(30, [step](std::span<Aabb> boxes) {
      for (std::size_t k = 0; k < boxes.size(); ++k) boxes[k] = k % step == 0 ? unit : inverted;
    });
    ASSERT_TRUE(twins.agree()) << step;
  }
  twins.map(30, [](std::span<Aabb> boxes) {
    for (const Aabb& box : boxes) ASSERT_FALSE(has_nan(box)) << "the caller wrote no NaN";
    boxes[1] = unit;
  });
  ASSERT_TRUE(twins.agree());
  EXPECT_EQ(twins.tested().pairs().size(), 15U);  // 0, 7, 14, 21, 28, and 1
}

TEST_P(EachAlgorithm, SmallMapMixesWithEverythingElse) {
  test::Twins twins(config());
  const auto write = [](std::span<Aabb> boxes) {
    for (std::size_t k = 0; k < boxes.size(); ++k) boxes[k] = apart(k % 5);
  };
  // Before the map, in the same update.
  for (int k = 0; k < 12; ++k) twins.add(unit, {.body = static_cast<std::uint32_t>(k / 2)});
  twins.remove(4);
  twins.remove(9);
  twins.set_filter(5, {.world = 1});
  twins.map(15, write);
  ASSERT_TRUE(twins.agree());
  // After it.
  twins.map(15, write);
  twins.move(2, apart(4));
  twins.remove(7);
  twins.remove(14);
  twins.set_filter(3, {.mask = 0});
  EXPECT_EQ(twins.add(apart(3)), 7U);
  EXPECT_EQ(twins.add(apart(3)), 14U);
  EXPECT_EQ(twins.add(apart(3)), 15U);
  ASSERT_TRUE(twins.agree());
  // Mapped memory that others' boxes make grow, and what was written to it.
  twins.map(16, write);
  for (std::uint32_t k = 0; k < 300; ++k) twins.add(apart(k));
  ASSERT_TRUE(twins.agree());
  // Filters of those that were there stay; those of removed ones do not come back.
  twins.map(4, write);
  ASSERT_TRUE(twins.agree());
  twins.map(6, [](std::span<Aabb> boxes) { std::fill(boxes.begin(), boxes.end(), unit); });
  ASSERT_TRUE(twins.agree());
  EXPECT_TRUE(same("pairs", twins.tested().pairs(),
                   Pairs{{0, 2}, {1, 2}, {0, 4}, {1, 4}, {2, 4}, {0, 5}, {1, 5}, {2, 5}, {4, 5}}));
  // And before a search that is begun.
  twins.map(6, write);
  twins.begin();
  twins.move(0, apart(4));
  twins.remove(1);
  EXPECT_EQ(twins.add(unit), 1U);
  ASSERT_TRUE(twins.agree());
}

}  // namespace
}  // namespace broadcl
