#include <broadcl/broad_phase.hpp>

#include <array>
#include <cfenv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "boxes64.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "rounding.hpp"
#include "runs.hpp"

/// Pairs of boxes in double precision are those of the caller's numbers.
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

void expect_exact(const BroadPhase::Config& config, const Boxes64& boxes, const std::string& name) {
  SCOPED_TRACE(name);
  EXPECT_TRUE(same("pairs", overlapping_pairs(boxes, {}, config), expected_pairs(boxes)));
}

TEST_P(EachAlgorithm, FootprintsInMapCoordinates) {
  expect_exact(config(), footprints(1, 0, 0), "near the origin");
  expect_exact(config(), footprints(2, 500'000, 6'460'000), "in map coordinates");
}

TEST_P(EachAlgorithm, BoxesThatSinglePrecisionCannotTellApart) {
  for (const double offset : {1.0, 1000.0, 1e7}) {
    expect_exact(config(), halves_of_steps(3, offset), std::to_string(offset));
  }
}

TEST_P(EachAlgorithm, InfiniteEmptyAndDenormalBoxesInDoublePrecision) {
  expect_exact(config(), special_boxes(), "special boxes");
  expect_exact(config(), {}, "no boxes");
  expect_exact(config(), Boxes64(3, {{1, 1, 1}, {0, 0, 0}}), "empty boxes only");
  Boxes64 half_empty = flush_cubes(5, 6.4e6);
  constexpr double largest = std::numeric_limits<double>::max();
  half_empty.resize(2 * half_empty.size(), {{largest, largest, largest}, {-largest, -largest, -largest}});
  expect_exact(config(), half_empty, "half of the boxes are empty");
  expect_exact(config(), Boxes64(3, {{0, infinity64, 0}, {0, infinity64, 0}}), "all at infinity");
}

TEST_P(EachAlgorithm, TwoSetsInDoublePrecisionAreExact) {
  const Boxes64 first = flush_cubes(5, 6.4e6);
  Boxes64 second = flush_cubes(6, 6.4e6);
  second.push_back({{1, 0, 0}, {0, 1, 1}});
  EXPECT_TRUE(same("pairs", overlapping_pairs(first, second, {}, config()), expected_pairs(first, second)));
}

TEST_P(EachAlgorithm, OneSetMayBeInSinglePrecision) {
  const Boxes64 first = halves_of_steps(4, 16);
  std::vector<Aabb> second;
  Boxes64 second64;
  for (int x = 0; x < 20; ++x) {
    const float at = 16 + static_cast<float>(x) * 2e-6F;
    second.push_back({{at, 16, 16}, {at, 17, 17}});
    second64.push_back({{static_cast<double>(at), 16, 16}, {static_cast<double>(at), 17, 17}});
  }
  EXPECT_TRUE(same("pairs", overlapping_pairs(first, second, {}, config()), expected_pairs(first, second64)));
  EXPECT_TRUE(same("pairs", overlapping_pairs(second, first, {}, config()), expected_pairs(second64, first)));
}

TEST_P(EachAlgorithm, ExclusionsInDoublePrecision) {
  const Boxes64 boxes = flush_cubes(4, 5e5);
  Pairs excluded;
  Pairs expected;
  for (const Pair& pair : expected_pairs(boxes)) (pair.a % 3 == 0 ? excluded : expected).push_back(pair);
  ASSERT_FALSE(excluded.empty());
  EXPECT_TRUE(same("pairs", overlapping_pairs(boxes, excluded, config()), expected));
}

TEST_P(EachAlgorithm, ANaNInDoublePrecisionIsNamed) {
  Boxes64 boxes = flush_cubes(2, 0);
  const Boxes64 good = boxes;
  boxes[5].upper[1] = std::nan("");
  EXPECT_THAT(error_of([&] { (void)overlapping_pairs(boxes, {}, config()); }), HasSubstr("box 5 has a NaN"));
  EXPECT_THAT(error_of([&] { (void)overlapping_pairs(boxes, good, {}, config()); }),
              HasSubstr("the first set: box 5 has a NaN"));
  EXPECT_THAT(error_of([&] { (void)overlapping_pairs(good, boxes, {}, config()); }),
              HasSubstr("the second set: box 5 has a NaN"));
}

TEST(ExactBoxes, NeitherRoundingNorFlushingOfTheCallerMatters) {
  Boxes64 apart(40, {{1e-42, 0, 0}, {1, 1, 1}});  // by a denormal number
  apart.resize(80, {{-1, 0.5, 0.5}, {0, 2, 2}});
  const std::vector<Boxes64> scenes{flush_cubes(6, 0), flush_cubes(6, 6.4e6), halves_of_steps(5, 1000),
                                    special_boxes(), apart};
  std::vector<Pairs> expected;
  expected.reserve(scenes.size());
  for (const Boxes64& boxes : scenes) expected.push_back(expected_pairs(boxes));
  for (const int mode : {FE_DOWNWARD, FE_UPWARD, FE_TOWARDZERO}) {
    const ScopedRounding rounding(mode);
    for (std::size_t k = 0; k < scenes.size(); ++k) {
      EXPECT_TRUE(
          same("pairs", overlapping_pairs(scenes[k], {}, {.algorithm = "sweep-and-prune"}), expected[k]));
      EXPECT_EQ(std::fegetround(), mode);
    }
  }
#ifdef __SSE2__
  const ScopedFlush flush;
  for (std::size_t k = 0; k < scenes.size(); ++k) {
    EXPECT_TRUE(
        same("pairs", overlapping_pairs(scenes[k], {}, {.algorithm = "sweep-and-prune"}), expected[k]));
  }
#endif
}

/// So many pairs that several threads test them, and only a few that touch, so that these are removed while
/// the others stay together.
TEST(ExactBoxes, FewOfManyPairsAreRemoved) {
  constexpr std::uint32_t n = 420;
  for (const std::size_t every : {1U, 7U, 100U}) {
    Boxes64 boxes;
    Pairs expected;
    for (std::uint32_t b = 0; b < n; ++b) {
      // All overlap each other, except that now and then one begins an ulp after all others end.
      const double begin = b % every == every - 1 ? std::nextafter(1.0, 2.0) : 0;
      boxes.push_back({{begin, 0, 0}, {std::max(begin, 1.0), 1, 1}});
    }
    expected = expected_pairs(boxes);
    for (const std::size_t threads : {1U, 3U, 5U}) {
      EXPECT_TRUE(same("pairs", overlapping_pairs(boxes, {}, {.threads = threads}), expected));
    }
  }
}

/// Enough for several threads, of which only the caller's rounds in another way.
NOT_IN(sanitizers, "tests 43 million pairs without optimisation");
TEST(ExactBoxes, ManyAreReadAndTestedByThreads) {
  const Boxes64 boxes = flush_cubes(21, 6.4e6);
  const Pairs expected = expected_pairs(boxes);
  for (const int mode : {FE_TONEAREST, FE_UPWARD, FE_DOWNWARD}) {
    const ScopedRounding rounding(mode);
    for (const std::size_t threads : {1U, 2U, 5U}) {
      EXPECT_TRUE(same("pairs", overlapping_pairs(boxes, {}, {.threads = threads}), expected));
    }
  }
}

/// Any layout: the rows of a matrix, and two dimensions.
TEST(ExactBoxes, OfAnyLayout) {
  const Boxes64 boxes = flush_cubes(4, 5e5);
  std::array<std::vector<double>, 6> columns;
  std::vector<double> flat;
  for (const Aabb64& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      columns[axis].push_back(box.lower[axis]);
      columns[axis + 3].push_back(box.upper[axis]);
    }
    flat.insert(flat.end(), {box.lower[0], box.lower[1], box.upper[0], box.upper[1]});
  }
  const BoxView view =
      BoxView::arrays<double>({columns[0].data(), columns[1].data(), columns[2].data()},
                              {columns[3].data(), columns[4].data(), columns[5].data()}, boxes.size());
  EXPECT_TRUE(same("pairs", overlapping_pairs(view), expected_pairs(boxes)));
  Boxes64 in_a_plane = boxes;
  for (Aabb64& box : in_a_plane) box.lower[2] = box.upper[2] = 0;
  EXPECT_TRUE(same("pairs", overlapping_pairs(BoxView::rectangles(flat.data(), boxes.size())),
                   expected_pairs(in_a_plane)));
  EXPECT_TRUE(same("pairs of a plane and space",
                   overlapping_pairs(BoxView::rectangles(flat.data(), boxes.size()), boxes),
                   expected_pairs(in_a_plane, boxes)));
}

}  // namespace
}  // namespace broadcl::test
