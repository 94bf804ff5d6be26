#include <broadcl/broad_phase64.hpp>

#include <algorithm>
#include <array>
#include <cfenv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "boxes64.hpp"
#include "core/core.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "exact.hpp"
#include "expect_error.hpp"
#include "rounding.hpp"
#include "runs.hpp"

/// A BroadPhase64 reports the changes of the pairs of the caller's numbers. (That it does so whatever the
/// calls, and if they fail, is tested by core_random_test.cpp and others, with warped.hpp.)
namespace broadcl::test {
namespace {

/// Moves bounds by an ulp of double precision, or by half a step of single precision about another one.
void walk(Boxes64& boxes, std::mt19937& random, double about) {
  const double step = static_cast<double>(std::nextafter(static_cast<float>(about), 1e30F)) - about;
  std::uniform_int_distribution<int> direction(-1, 1);
  for (Aabb64& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int by = direction(random);
      double& bound = direction(random) > 0 ? box.lower[axis] : box.upper[axis];
      if (by < 0) bound = std::nextafter(bound, -infinity64);
      if (by > 0) bound += step / 2;
    }
  }
}

TEST_P(EachAlgorithm, FootprintsAndHalvesOfStepsHaveExactChanges) {
  Exact exact(config());
  for (const std::uint32_t seed : {1U, 2U, 3U}) {
    Boxes64 boxes = footprints(seed, 500'000, 6'460'000);
    exact.update(boxes, "footprints");
    std::mt19937 random(seed);
    walk(boxes, random, 0.1);
    exact.update(boxes, "footprints, some with a height");
    boxes = halves_of_steps(seed, 1e7);
    exact.update(boxes, "halves of steps");
  }
}

/// Boxes that become small, so that another map tells them apart, of which only one moves when that is used.
TEST_P(EachAlgorithm, ABetterMapIsUsedForAllBoxes) {
  Boxes64 large(200);
  Boxes64 small(200);
  for (std::size_t k = 0; k < large.size(); ++k) {
    const double x = 1e6 * static_cast<double>(k);
    const double y = 1e8 + 0.005 * static_cast<double>(k);
    large[k] = {{x, 0, 0}, {x + 1.5e6, 1, 1}};
    small[k] = {{y, 0, 0}, {y + 0.0075, 1, 1}};
  }
  Exact exact(config());
  for (int frame = 0; frame < 3; ++frame) exact.update(large, "large");
  exact.update(small, "small");
  small[40].upper[0] += 0.001;
  exact.update(small, "of which one moves");
}

/// A window in a gap moves on although some boxes stay where it was.
TEST_P(EachAlgorithm, BoxesThatAWindowLeavesAreConvertedAgain) {
  Boxes64 boxes(200);
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const double x = (k < 100 ? 0 : 1e7) + 0.7 * static_cast<double>(k % 100);
    boxes[k] = {{x, 0, 0}, {x + 1, 1, 1}};
  }
  BroadPhase64 broad_phase(config());
  const auto expect_exact = [&](const std::string& what) {
    (void)broad_phase.update(boxes);
    EXPECT_TRUE(same("pairs", broad_phase.pairs(), expected_pairs(boxes))) << what;
  };
  for (int frame = 0; frame < 3; ++frame) expect_exact("in two places");
  boxes[3] = {{4e6, 0, 0}, {4e6 + 1, 1, 1}};
  for (int frame = 0; frame < 3; ++frame) expect_exact("one between them");
  boxes[50].upper[1] = 2;
  expect_exact("which stays");
  boxes[20] = {{5e6 - 20, 0, 0}, {5e6 + 20, 1, 1}};
  expect_exact("and another one");
}

TEST_P(EachAlgorithm, BoxesOfAPlaneAndOfSpaceInDoublePrecision) {
  std::vector<double> rectangles;
  for (int k = 0; k < 40; ++k) {
    const double x = 6.46e6 + 0.1 * k;
    rectangles.insert(rectangles.end(), {x, 0, x + 0.1, 1});
  }
  Boxes64 flat(40);
  for (std::size_t k = 0; k < flat.size(); ++k) {
    flat[k] = {{rectangles[4 * k], 0, 0}, {rectangles[4 * k + 2], 1, 0}};
  }
  BroadPhase64 broad_phase(config());
  const Pairs pairs = expected_pairs(flat);
  EXPECT_TRUE(same(broad_phase.update(BoxView::rectangles(rectangles.data(), 40)), pairs, {}));
  // Above all of them, by less than the bounds that boxes of a plane get for the search.
  broad_phase.add(Aabb64{{0, 0, 1e-9}, {1e7, 1, 1}});
  EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  broad_phase.move(40, Aabb64{{0, 0, 0}, {1e7, 1, 1}});
  EXPECT_EQ(broad_phase.update().added.size(), 40U);
  EXPECT_EQ(broad_phase.update(flat).removed.size(), 40U);
  EXPECT_TRUE(same("pairs", broad_phase.pairs(), pairs));
}

/// Neither reads boxes of which there are too many.
template <class Subject>
void expect_counts_to_be_refused() {
  Subject broad_phase({.algorithm = "sweep-and-prune"});
  const std::array<double, 6> one{0, 0, 0, 1, 1, 1};
  const std::uint32_t id = broad_phase.add(BoxView::interleaved(one.data(), 1)).front();
  const BoxView boxes = BoxView::interleaved(one.data(), std::size_t{1} << 50U);
  EXPECT_THAT(error_of([&] { (void)broad_phase.update(boxes); }), ::testing::HasSubstr("are too many"));
  EXPECT_THAT(error_of([&] { broad_phase.begin(boxes); }), ::testing::HasSubstr("are too many"));
  EXPECT_THAT(error_of([&] { (void)broad_phase.add(boxes); }), ::testing::HasSubstr("are too many"));
  EXPECT_THAT(error_of([&] { (void)broad_phase.map(boxes.size()); }), ::testing::HasSubstr("are too many"));
  EXPECT_THAT(error_of([&] { broad_phase.move({&id, 1}, boxes); }), ::testing::HasSubstr("as many of both"));
  const std::array<Filter, 2> filters{};
  EXPECT_THAT(error_of([&] { (void)broad_phase.add(boxes, filters); }),
              ::testing::HasSubstr("2 filters for"));
  EXPECT_EQ(broad_phase.size(), 1U);
}

TEST(BroadPhase64, RefusesCountsBeforeItReads) {
  expect_counts_to_be_refused<BroadPhase64>();
  expect_counts_to_be_refused<BroadPhase>();
}

TEST(BroadPhase64, NeitherRoundingNorFlushingOfTheCallerMatters) {
  for (const int mode : {FE_DOWNWARD, FE_UPWARD, FE_TOWARDZERO}) {
    const ScopedRounding rounding(mode);
    Exact exact({.algorithm = "sweep-and-prune"});
    for (const Boxes64& boxes : {flush_cubes(5, 6.4e6), halves_of_steps(5, 1000), special_boxes()}) {
      for (int way = 0; way < 4; ++way) exact.update(boxes, "rounding");
    }
    EXPECT_EQ(std::fegetround(), mode);
  }
#ifdef __SSE2__
  const ScopedFlush flush;
  const std::vector<Aabb> denormal{{{1e-40F, 0, 0}, {2e-40F, 1, 1}}, {{3e-40F, 0, 0}, {4e-40F, 1, 1}}};
  BroadPhase64 single({.algorithm = "sweep-and-prune"});
  EXPECT_TRUE(same(single.update(denormal), {}, {}));
  const Boxes64 first_only{single.box(0)};
  EXPECT_TRUE(same("pairs", overlapping_pairs(denormal, first_only, {}, {.algorithm = "sweep-and-prune"}),
                   Pairs{{0, 0}}));
  Exact exact({.algorithm = "sweep-and-prune"});
  for (int frame = 0; frame < 8; ++frame) {
    exact.update(frame % 2 == 0 ? special_boxes() : flush_cubes(3, 0), "flushing");
  }
#endif
}

/// Many boxes, which threads convert, and many pairs that touch, which they compare.
NOT_IN(sanitizers, "tests ten million pairs without optimisation");
TEST(BroadPhase64, ManyAreComparedByThreads) {
  Boxes64 boxes = flush_cubes(17, 6.4e6);
  for (const std::size_t threads : {1U, 3U}) {
    Exact exact({.algorithm = "sweep-and-prune", .threads = threads});
    exact.update(boxes, "cubes");
    std::mt19937 random(3);
    walk(boxes, random, 6.4e6);
    exact.update(boxes, "moved");
  }
}

TEST(BroadPhase64, ShrinksAndKeepsMappedMemory) {
  BroadPhase64 broad_phase({.algorithm = "sweep-and-prune"});
  const Boxes64 boxes = flush_cubes(5, 1e6);
  std::optional<MappedBoxes64> mapped = broad_phase.map(boxes.size());
  std::ranges::copy(boxes, mapped->begin());
  (void)broad_phase.update();
  const Boxes64 thousand(1000, boxes[0]);
  (void)broad_phase.add(thousand);
  (void)broad_phase.update(thousand);
  (void)broad_phase.update(boxes);
  EXPECT_EQ(mapped->size(), boxes.size());
  EXPECT_GE(mapped->front().lower[0], 0);
  broad_phase.shrink();
  EXPECT_TRUE(same("pairs", broad_phase.pairs(), expected_pairs(boxes)));
  broad_phase.remove(0);
  broad_phase.shrink();
  EXPECT_FALSE(broad_phase.update().removed.empty());
  { const BroadPhase64 gone = std::move(broad_phase); }
  EXPECT_GE(mapped->back().lower[0], 0);
}

/// How many of the boxes that an algorithm reads are different.
std::size_t different_boxes(Algorithm& algorithm, std::size_t n) {
  std::set<std::array<float, 3>> lower;
  for (const Aabb& box : algorithm.boxes().first(n)) lower.insert(box.lower);
  return lower.size();
}

/// Boxes that fly so far away that single precision could not tell them apart about their first place.
TEST(BroadPhase64, TheMapFollowsTheBoxes) {
  for (const bool maps : {false, true}) {
    AlgorithmPointer algorithm = make_algorithm({.algorithm = "sweep-and-prune"});
    Algorithm& inside = *algorithm;
    Core<Aabb64> core(std::move(algorithm));
    Boxes64 boxes = flush_cubes(5, 0);
    const auto update = [&] {
      if (maps) {
        std::ranges::copy(boxes, core.map(boxes.size()).begin());
        (void)core.finish();
      } else {
        (void)core.update(boxes);
      }
      ASSERT_TRUE(same("pairs", core.pairs(), expected_pairs(boxes)));
    };
    for (int frame = 0; frame < 20; ++frame) {
      update();
      EXPECT_EQ(different_boxes(inside, boxes.size()), boxes.size());
      for (Aabb64& box : boxes) {
        box.lower[1] += 3e6;
        box.upper[1] += 3e6;
      }
    }
  }
}

}  // namespace
}  // namespace broadcl::test
