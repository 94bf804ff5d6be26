#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <random>
#include <set>
#include <vector>

#include <gtest/gtest.h>

#include "base/packed_box.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "environment.hpp"
#include "scenes/generators.hpp"
#include "twins.hpp"

/// Searches find exactly the pairs that exist: for any numbers, any size, any number of pairs, and the same
/// each time.
namespace broadcl::test {
namespace {

using Limits = std::numeric_limits<float>;

// Numbers.

/// Bounds with which arithmetic would fail, but comparisons do not.
std::vector<float> special_bounds() {
  std::vector<float> bounds{0};
  for (const float magnitude :
       {Limits::denorm_min(), 2 * Limits::denorm_min(), std::nextafter(Limits::min(), 0.0F), Limits::min(),
        1e-30F, std::nextafter(1.0F, 0.0F), 1.0F, std::nextafter(1.0F, 2.0F), 1e30F,
        std::nextafter(Limits::max(), 0.0F), Limits::max(), Limits::infinity()}) {
    bounds.push_back(magnitude);
  }
  for (std::size_t k = bounds.size(); k-- > 0;) bounds.push_back(-bounds[k]);
  return bounds;
}

/// Boxes with such bounds: points, flat ones, half spaces, planes, points at infinity, empty ones.
std::vector<Aabb> special_boxes(std::uint32_t n, std::uint32_t seed) {
  static const std::vector<float> bounds = special_bounds();
  std::mt19937 random(seed);
  const auto below = [&](std::size_t count) { return random() % count; };
  std::vector<Aabb> boxes(n);
  for (Aabb& box : boxes) {
    const bool may_be_empty = below(8) == 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      float& lower = box.lower[axis];
      float& upper = box.upper[axis];
      lower = bounds[below(bounds.size())];
      // Equal to the lower bound or next to it, or any other.
      const auto place =
          static_cast<std::size_t>(std::find(bounds.begin(), bounds.end(), lower) - bounds.begin());
      upper = bounds[below(3) == 0 ? std::min(bounds.size() - 1, place + below(2)) : below(bounds.size())];
      if (lower > upper && !may_be_empty) std::swap(lower, upper);
      if (below(4) == 0) {
        lower = -Limits::infinity();
        upper = Limits::infinity();
      }
    }
  }
  return boxes;
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallSpecialBoundsAgreeWithTheOracle) {
  for (std::uint32_t seed = 1; seed <= 3; ++seed)
    expect_oracle(special_boxes(90, seed), std::to_string(seed));
}

NOT_IN(gpu_profile | sanitizers, "takes long, and rusticl has this tuning");
TEST_P(EachAlgorithm, ManySpecialBoundsAgreeWithTheOracle) {
  const std::uint32_t draws = is_slow() ? 5 : 20;
  for (std::uint32_t seed = 1; seed <= draws; ++seed) {
    expect_oracle(special_boxes(500, 100 + seed), "seed " + std::to_string(seed));
  }
}

/// The same if few boxes moved, with worlds and without.
ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallSpecialBoundsThatMoveAgreeWithTheOracle) {
  for (const bool worlds : {false, true}) {
    Twins twins(config());
    for (const Aabb& box : special_boxes(70, 50))
      twins.add(box, {.world = worlds ? static_cast<std::uint32_t>(twins.tested().size() % 2) : 0});
    ASSERT_TRUE(twins.agree());
    std::mt19937 random(7);
    const auto below = [&](std::uint32_t count) { return static_cast<std::uint32_t>(random() % count); };
    for (std::uint32_t frame = 0; frame < 5; ++frame) {
      for (const Aabb& box : special_boxes(5, 60 + frame)) twins.move(below(70), box);
      ASSERT_TRUE(twins.agree()) << frame;
    }
  }
}

/// Each axis alone separates two boxes, by the smallest possible distance.
ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallTouchingAndBarelyApart) {
  const float tiny = Limits::denorm_min();
  const float large = Limits::max();
  struct Case {
    float upper, lower;  // bounds of the box below and of the one above
    bool touch;
  };
  const std::array cases{Case{1, 1, true},
                         Case{1, std::nextafter(1.0F, 2.0F), false},
                         Case{0, 0, true},
                         Case{0, -0.0F, true},
                         Case{-0.0F, 0, true},
                         Case{tiny, tiny, true},
                         Case{-tiny, -tiny, true},
                         Case{1e30F, 1e30F, true},
                         Case{1e30F, std::nextafter(1e30F, 2e30F), false},
                         Case{large, large, true},
                         Case{std::nextafter(large, 0.0F), large, false},
                         Case{-large, std::nextafter(-large, 0.0F), false},
                         Case{large, Limits::infinity(), false},
                         Case{-Limits::infinity(), -large, false},
                         Case{Limits::infinity(), Limits::infinity(), true},
                         Case{-Limits::infinity(), -Limits::infinity(), true},
                         Case{Limits::min(), std::nextafter(Limits::min(), 1.0F), false},
                         Case{0, tiny, false},
                         Case{-tiny, 0, false},
                         Case{-tiny, -0.0F, false},
                         Case{-tiny, tiny, false},
                         Case{tiny, 2 * tiny, false}};
  // Two boxes per case, apart from those of the other cases on another axis.
  for (std::size_t axis = 0; axis < 3; ++axis) {
    BroadPhase broad_phase(config());
    Pairs touching;
    for (std::uint32_t k = 0; k < cases.size(); ++k) {
      Aabb below = unit;
      below.lower[(axis + 1) % 3] = apart(k).lower[0];
      below.upper[(axis + 1) % 3] = apart(k).upper[0];
      Aabb above = below;
      below.lower[axis] = -Limits::infinity();
      below.upper[axis] = cases[k].upper;
      above.lower[axis] = cases[k].lower;
      above.upper[axis] = Limits::infinity();
      if (k % 2 == 1) std::swap(below, above);
      broad_phase.add(below);
      broad_phase.add(above);
      if (cases[k].touch) touching.push_back({2 * k, 2 * k + 1});
    }
    EXPECT_TRUE(same(broad_phase.update(), touching, {})) << "axis " << axis;
  }
}

// Sizes.

/// Some boxes move, in one world and in three.
void move_some(const BroadPhase::Config& config, std::uint32_t n) {
  for (const std::uint32_t worlds : {1U, 3U}) {
    scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::mixed, n);
    Twins twins(config);
    for (std::uint32_t id = 0; id < n; ++id) twins.add(boxes.boxes()[id], {.world = id % worlds});
    ASSERT_TRUE(twins.agree()) << n;
    for (const std::uint32_t step : {n, n / 2 + 1, 8U, 4U, 3U, 2U, 1U, n, 4U}) {
      for (int k = 0; k < 5; ++k) boxes.advance();
      for (std::uint32_t id = step / 2; id < n; id += step)
        twins.move(id, id % 16 == 7 ? inverted : boxes.boxes()[id]);
      ASSERT_TRUE(twins.agree()) << n << ", each " << step << "th in " << worlds << " worlds";
    }
  }
}

ALSO_IN(oclgrind);
NOT_IN(sanitizers, "takes long");
TEST_P(EachAlgorithm, SmallSomeMoved) {
  for (const std::uint32_t n : {3U, 18U}) move_some(config(), n);
}

NOT_IN(gpu_profile | rusticl | sanitizers, "takes long");
TEST_P(EachAlgorithm, SizesAroundPowersOfTwoOfWhichSomeMoved) {
  for (const std::uint32_t n : {1U, 2U, 4U, 5U, 8U, 16U, 17U, 31U, 32U, 33U, 40U, 255U, 256U, 257U, 1025U}) {
    if (n < 1000 || !is_slow()) move_some(config(), n);
  }
}

/// Pairs by sorting along an axis and sweeping: it shares nothing with any algorithm here.
Pairs sweep(std::span<const Aabb> boxes) {
  std::vector<std::uint32_t> order(boxes.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t s, std::uint32_t t) { return boxes[s].lower[0] < boxes[t].lower[0]; });
  Pairs pairs;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Aabb& box = boxes[order[k]];
    for (std::size_t m = k + 1; m < order.size() && boxes[order[m]].lower[0] <= box.upper[0]; ++m) {
      if (overlaps(box, boxes[order[m]]))
        pairs.push_back({std::min(order[k], order[m]), std::max(order[k], order[m])});
    }
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

NOT_IN(all_default | gpu_profile | rusticl | sanitizers, "takes minutes");
TEST(BruteForce, AHundredThousandBoxes) {
  if (is_slow_device()) GTEST_SKIP() << "takes minutes on this device";
  constexpr std::uint32_t n = 100'000;
  scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::uniform);
  BroadPhase broad_phase({.algorithm = "brute-force"});
  for (const Aabb& box : boxes.boxes()) broad_phase.add(box);
  ASSERT_TRUE(same(broad_phase.update(), sweep(boxes.boxes()), {}));
  std::vector<Aabb> moved(boxes.boxes().begin(), boxes.boxes().end());
  boxes.advance();
  for (std::uint32_t id = 0; id < n; id += 50) {
    moved[id] = boxes.boxes()[id];
    broad_phase.move(id, moved[id]);
  }
  (void)broad_phase.update();
  EXPECT_TRUE(same("few moved", broad_phase.pairs(), sweep(moved)));
}

/// More tests than a launch has at once with the tuning for CPUs: host/finders/row_launch.hpp.
NOT_IN(gpu_profile | rusticl | sanitizers, "takes long");
TEST(BruteForce, SeveralLaunchesFindEachPairOnce) {
  if (is_slow_device()) GTEST_SKIP() << "takes minutes on this device";
  const scenes::MovingBoxes boxes(50'000, scenes::MovingBoxes::Sizes::uniform);
  const Pairs expected = sweep(boxes.boxes());
  for (const char* algorithm : {"brute-force", "gpu-bf"}) {
    EXPECT_TRUE(same(algorithm, overlapping_pairs(boxes.boxes(), {}, {.algorithm = algorithm}), expected));
  }
}

/// Ids too large for a float. A search of all boxes would take hours, so only a few of 17 million objects
/// change.
NOT_IN(rusticl | sanitizers, "takes long");
TEST(BruteForce, IdsPast24Bits) {
  if (is_slow_device()) GTEST_SKIP() << "takes minutes on this device";
  constexpr std::uint32_t n = 17'000'000;
  constexpr std::uint32_t past = (1U << 24) + 1;
  const auto algorithm = make_algorithm({.algorithm = "brute-force"});
  algorithm->reserve(n, false);
  std::ranges::fill(algorithm->boxes(), packed_empty());
  // More pairs than are ordered without sorting.
  std::vector<std::uint32_t> changed{n - 1,    0, past,      past - 1,  past - 2,
                                     past + 1, 1, past + 15, past + 16, past + 63};
  while (changed.size() < 24) changed.push_back(changed.back() + 1001);
  for (const std::uint32_t id : changed) algorithm->boxes()[id] = unit;
  const std::set<std::uint32_t> members(changed.begin(), changed.end());
  Pairs expected;
  for (const std::uint32_t b : members) {
    for (const std::uint32_t a : members) {
      if (a < b) expected.push_back({a, b});
    }
  }
  algorithm->begin({.boxes = algorithm->boxes().first(n), .changed = {.slots = changed}});
  EXPECT_TRUE(same(algorithm->finish(), expected, {}));
  EXPECT_TRUE(same("pairs", algorithm->pairs(), expected));

  // One object leaves, and a new one takes the id of another.
  const std::vector<std::uint32_t> next{past, n - 1};
  algorithm->boxes()[past] = apart(9);
  Pairs of_last;
  Pairs ended;
  std::ranges::copy_if(expected, std::back_inserter(of_last),
                       [](const Pair& pair) { return pair.b == n - 1 && pair.a != past; });
  std::ranges::copy_if(expected, std::back_inserter(ended),
                       [](const Pair& pair) { return pair.b == n - 1 || pair.a == past || pair.b == past; });
  const std::vector<std::uint32_t> recycled{n - 1};
  algorithm->begin({.boxes = algorithm->boxes().first(n), .changed = {.slots = next, .recycled = recycled}});
  EXPECT_TRUE(same(algorithm->finish(), of_last, ended));
}

// Any number of pairs.

/// Whether a list holds every pair of n objects, without a second list to compare with.
::testing::AssertionResult has_all_pairs(std::span<const Pair> pairs, std::uint32_t n) {
  std::size_t at = 0;
  for (std::uint32_t b = 0; b < n; ++b) {
    for (std::uint32_t a = 0; a < b; ++a, ++at) {
      if (at < pairs.size() && pairs[at] == Pair{a, b}) continue;
      return ::testing::AssertionFailure()
             << pairs.size() << " pairs, and not (" << a << ", " << b << ") at " << at;
    }
  }
  if (at == pairs.size()) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << pairs.size() << " pairs, expected " << at;
}

/// More pairs than the first capacity, and changes that are sorted.
ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallListsOfPairsGrow) {
  constexpr std::uint32_t n = 184;  // the first capacity is 16,384 pairs
  BroadPhase broad_phase(config());
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(unit);
  ASSERT_TRUE(has_all_pairs(broad_phase.update().added, n));
  broad_phase.move(3, apart(1));
  ASSERT_EQ(broad_phase.update().removed.size(), n - 1);
}

/// All boxes leave one place and come back; then few of them do.
void expect_all_pairs_to_go_and_come(const BroadPhase::Config& config, std::uint32_t n) {
  BroadPhase broad_phase(config);
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(unit);
  const auto expect = [&](bool come) {
    const Delta delta = broad_phase.update();
    EXPECT_TRUE(has_all_pairs(come ? delta.added : delta.removed, n));
    EXPECT_TRUE((come ? delta.removed : delta.added).empty());
  };
  expect(true);
  for (int round = 0; round < 2; ++round) {
    for (std::uint32_t k = 1; k < n; ++k) broad_phase.move(k, apart(k));
    expect(false);
    EXPECT_TRUE(broad_phase.pairs().empty());
    for (std::uint32_t k = 1; k < n; ++k) broad_phase.move(k, unit);
    expect(true);
  }
  for (std::uint32_t k = 0; k < 3; ++k) broad_phase.move(k, apart(1 + k));
  EXPECT_EQ(broad_phase.update().removed.size(), 3 * (n - 3) + 3);
  for (std::uint32_t k = 0; k < 3; ++k) broad_phase.move(k, unit);
  EXPECT_EQ(broad_phase.update().added.size(), 3 * (n - 3) + 3);
  EXPECT_TRUE(has_all_pairs(broad_phase.pairs(), n));
}

/// With either tuning, more changes than are sorted by comparing each with every other.
ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_P(EachAlgorithm, SmallEveryPairOfAHundredGoesAndComes) {
  expect_all_pairs_to_go_and_come(config(), 100);
}

TEST_P(EachAlgorithm, EveryPairOfHundredsGoesAndComes) {
  expect_all_pairs_to_go_and_come(config(), 700);
}

NOT_IN(gpu_profile | rusticl | sanitizers, "takes long");
TEST_P(EachDeviceAlgorithm, EveryPairOfThousandsGoesAndComes) {
  expect_all_pairs_to_go_and_come(config(), is_slow() ? 1000 : 3000);
}

// For long.

/// (With PoCL 3.1 and 6.0, one frame in several hundred was wrong: work-groups wrote past their part of the
/// list, sometimes later than the work-group that owned that part.)
ALSO_IN(kernels);
NOT_IN(sanitizers, "takes long, in kernels only");
TEST_P(EachAlgorithm, FewBoxesThatMoveForLongWithBothProfiles) {
  constexpr std::uint32_t n = 200;
  const int frames = is_slow() ? 8 : 500;
  for (const std::string profile : {"cpu", "gpu"}) {
    const ScopedVariable variable("BROADCL_TUNING", profile);
    scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::mixed);
    BroadPhase is({.algorithm = std::string(GetParam().name)});
    BroadPhase expected({.algorithm = "oracle"});
    for (int frame = 0; frame < frames; ++frame) {
      std::ranges::copy(boxes.boxes(), is.map(n).begin());
      std::ranges::copy(boxes.boxes(), expected.map(n).begin());
      const Delta changes = is.update();
      const Delta expected_changes = expected.update();
      ASSERT_TRUE(std::ranges::equal(changes.added, expected_changes.added))
          << profile << ", frame " << frame;
      ASSERT_TRUE(std::ranges::equal(changes.removed, expected_changes.removed))
          << profile << ", frame " << frame;
      boxes.advance();
    }
  }
}

}  // namespace
}  // namespace broadcl::test
