#include <algorithm>
#include <cstdint>
#include <list>
#include <span>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "base/pair_lists.hpp"
#include "core/exclusions.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "scenes/generators.hpp"
#include "twins.hpp"

/// Pairs that are never reported.
namespace broadcl::test {
namespace {

using scenes::MovingBoxes;
using ::testing::HasSubstr;

Pairs every(std::size_t step, const Pairs& pairs) {
  Pairs some;
  for (std::size_t k = 0; k < pairs.size(); k += step) some.push_back(pairs[k]);
  return some;
}

/// Updates of n boxes with exclusions.
void follow(const BroadPhase::Config& config, std::uint32_t n) {
  MovingBoxes motion(n, MovingBoxes::Sizes::mixed);
  Twins twins(config);
  for (std::uint32_t k = 0; k < n; ++k) twins.add(motion.boxes()[k], {.body = k / 2});
  const auto advance = [&](std::uint32_t step) {
    motion.advance();
    for (std::uint32_t k = 0; k < n; k += step) twins.move(k, motion.boxes()[k]);
  };
  ASSERT_TRUE(twins.agree());
  const Pairs all = twins.pairs();
  ASSERT_GT(all.size(), n / 4);
  twins.set_exclusions(every(2, all));
  ASSERT_TRUE(twins.agree()) << "some known pairs";
  advance(1);
  ASSERT_TRUE(twins.agree()) << "while all move";
  twins.set_exclusions(every(3, all));
  advance(20);
  ASSERT_TRUE(twins.agree()) << "others, while some move";
  advance(20);
  ASSERT_TRUE(twins.agree()) << "while some move";
  twins.set_exclusions(all_pairs(std::min(n, 300U)));
  ASSERT_TRUE(twins.agree()) << "all pairs of the first boxes";
  twins.set_exclusions({});
  ASSERT_TRUE(twins.agree()) << "none";
}

/// Searches n boxes with exclusions, once as one set and once as two.
void search_once(const BroadPhase::Config& config, std::uint32_t n) {
  const MovingBoxes motion(n, MovingBoxes::Sizes::mixed);
  const std::span<const Aabb> boxes = motion.boxes();
  const Pairs all = overlapping_pairs(boxes, {}, {.algorithm = "oracle"});
  ASSERT_GT(all.size(), n / 4);
  const Pairs some = every(2, all);
  Pairs given = every(3, all_pairs(std::min(n, 100U)));  // most of them do not overlap
  given.insert(given.end(), some.begin(), some.end());
  const Pairs expected = difference(all, sorted_exclusions(given));
  for (Pair& pair : given) {
    if (pair.a % 2 == 0) std::swap(pair.a, pair.b);
  }
  EXPECT_TRUE(same("one set", overlapping_pairs(boxes, given, config), expected));
  EXPECT_TRUE(same("all", overlapping_pairs(boxes, all, config), {}));

  const std::span<const Aabb> first = boxes.first(n / 3);
  const std::span<const Aabb> second = boxes.subspan(n / 3);
  const Pairs between = overlapping_pairs(first, second, {}, {.algorithm = "oracle"});
  Pairs without = every(2, between);
  // In two sets, both indices of a pair may be equal.
  for (std::uint32_t k = 0; k < first.size(); ++k) without.push_back({k, k});
  Pairs sorted = without;
  std::ranges::sort(sorted);
  std::ranges::reverse(without);
  EXPECT_TRUE(
      same("two sets", overlapping_pairs(first, second, without, config), difference(between, sorted)));
  EXPECT_TRUE(same("all of two sets", overlapping_pairs(first, second, between, config), {}));
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallExclusionsAreNotReported) {
  follow(config(), 60);
  search_once(config(), 60);
}

TEST_P(EachAlgorithm, ExclusionsAreNotReported) {
  follow(config(), is_slow() ? 500 : 1500);
  search_once(config(), is_slow() ? 500 : 1500);
}

TEST(Exclusions, OfOneSearchAreOfBoxesThatAreThere) {
  const BroadPhase::Config oracle{.algorithm = "oracle"};
  const std::vector<Aabb> three(3, unit);
  const std::vector<Aabb> two(2, unit);
  const auto one_set = [&](const Pairs& pairs) {
    return error_of([&] { (void)overlapping_pairs(three, pairs, oracle); });
  };
  const auto two_sets = [&](const Pairs& pairs) {
    return error_of([&] { (void)overlapping_pairs(three, two, pairs, oracle); });
  };
  EXPECT_THAT(one_set({{0, 1}, {1, 3}}), HasSubstr("exclusion (1, 3) is of a box that is not there; give "
                                                   "indices below 3"));
  EXPECT_THAT(one_set({{3, 1}}), HasSubstr("(3, 1)"));
  EXPECT_THAT(one_set({{2, 2}}), HasSubstr("an exclusion is of 2 and itself"));
  EXPECT_THAT(two_sets({{2, 1}, {1, 2}}), HasSubstr("(1, 2) is of a box that is not there; give indices "
                                                    "below 3 and 2"));
  EXPECT_THAT(two_sets({{3, 1}}), HasSubstr("(3, 1)"));
  EXPECT_THAT(two_sets({{0, 0xffffffff}}), HasSubstr("(0, 4294967295)"));
  EXPECT_EQ(overlapping_pairs(three, two, Pairs{{1, 1}, {0, 1}, {1, 0}, {2, 0}}, oracle),
            (Pairs{{0, 0}, {2, 1}}));
}

/// A list, which has no BoxView, can have exclusions, too.
TEST(Exclusions, OfAnyRange) {
  const std::list<Aabb> boxes(3, unit);
  EXPECT_EQ(overlapping_pairs(boxes, Pairs{{2, 0}}, {.algorithm = "oracle"}), (Pairs{{0, 1}, {1, 2}}));
}

TEST(Exclusions, APairOfAnIdWithItselfIsRefused) {
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  broad_phase.set_exclusions(Pairs{{0, 1}});
  EXPECT_THAT(error_of([&] {
                broad_phase.set_exclusions(Pairs{{0, 2}, {3, 3}});
              }),
              HasSubstr("an exclusion is of 3 and itself"));
  for (int k = 0; k < 3; ++k) broad_phase.add(unit);
  EXPECT_EQ(to_vector(broad_phase.update().added), (Pairs{{0, 2}, {1, 2}})) << "the old ones still hold";
}

TEST(Exclusions, OfObjectsThatShareLabels) {
  EXPECT_EQ(pairs_that_share(std::vector<std::uint32_t>{1, 2, 2, 3, 9, 9, 3, 1}, 2),
            (Pairs{{0, 1}, {0, 3}, {1, 3}}));
  EXPECT_EQ(pairs_that_share(std::vector<std::uint32_t>{5, 6, 7, 7, 6, 5}, 3), (Pairs{{0, 1}}))
      << "each pair once";
  EXPECT_EQ(pairs_that_share({}, 3), Pairs());
  EXPECT_EQ(pairs_that_share({}, 0), Pairs());
  EXPECT_THAT(error_of([] { (void)pairs_that_share(std::vector<std::uint32_t>(5), 2); }),
              HasSubstr("5 labels are not 2 for each object"));
  EXPECT_THAT(error_of([] { (void)pairs_that_share(std::vector<std::uint32_t>(5), 0); }),
              HasSubstr("5 labels are not 0"));
}

TEST(Exclusions, OfTwoSetsThatShareLabels) {
  const std::vector<std::uint32_t> faces{1, 2, 3, 3, 2, 7};
  const std::vector<std::uint32_t> vertices{0, 1, 2, 3};
  EXPECT_EQ(pairs_that_share(faces, 3, vertices, 1), (Pairs{{0, 1}, {0, 2}, {1, 2}, {0, 3}, {1, 3}}));
  EXPECT_EQ(pairs_that_share(vertices, 1, faces, 3), (Pairs{{1, 0}, {2, 0}, {3, 0}, {2, 1}, {3, 1}}));
  EXPECT_EQ(pairs_that_share(vertices, 2, faces, 3), (Pairs{{0, 0}, {1, 0}, {1, 1}})) << "each pair once";
  EXPECT_EQ(pairs_that_share({}, 0, faces, 3), Pairs());
  EXPECT_EQ(pairs_that_share(faces, 3, {}, 1), Pairs());
  EXPECT_THAT(error_of([&] { (void)pairs_that_share(vertices, 1, faces, 4); }),
              HasSubstr("6 labels are not 4 for each object"));
  EXPECT_THAT(error_of([&] { (void)pairs_that_share(vertices, 3, faces, 3); }),
              HasSubstr("4 labels are not 3 for each object"));
}

}  // namespace
}  // namespace broadcl::test
