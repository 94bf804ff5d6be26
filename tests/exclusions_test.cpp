#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "pair_lists.hpp"
#include "scenes/generators.hpp"

/// Pairs that are never reported.
namespace broadcl::test {
namespace {

using scenes::MovingBoxes;

/// A broad phase with exclusions, and an oracle without, of whose pairs they are taken.
class Follower {
 public:
  Follower(const BroadPhase::Config& config, std::uint32_t n)
      : motion_(n, MovingBoxes::Sizes::mixed), tested_(config) {
    for (const Aabb& box : motion_.boxes()) {
      tested_.add(box, {.body = count_ / 2});
      oracle_.add(box, {.body = count_ / 2});
      ++count_;
    }
  }

  void exclude(Pairs pairs) {
    tested_.set_exclusions(pairs);
    for (Pair& pair : pairs) pair = {std::min(pair.a, pair.b), std::max(pair.a, pair.b)};
    std::ranges::sort(pairs);
    exclusions_ = pairs;
  }

  /// Moves every step-th box.
  void advance(std::uint32_t step) {
    motion_.advance();
    for (std::uint32_t k = 0; k < count_; k += step) {
      tested_.move(k, motion_.boxes()[k]);
      oracle_.move(k, motion_.boxes()[k]);
    }
  }

  [[nodiscard]] ::testing::AssertionResult agrees() {
    (void)oracle_.update();
    const Pairs now = difference(oracle_.pairs(), exclusions_);
    const Delta delta = tested_.update();
    const auto result = same(delta, difference(now, pairs_), difference(pairs_, now));
    pairs_ = now;
    return result ? same("pairs", tested_.pairs(), now) : result;
  }

  [[nodiscard]] const Pairs& pairs() const { return pairs_; }

 private:
  MovingBoxes motion_;
  BroadPhase tested_;
  BroadPhase oracle_{{.algorithm = "oracle"}};
  std::uint32_t count_ = 0;
  Pairs exclusions_, pairs_;
};

Pairs every(std::size_t step, const Pairs& pairs) {
  Pairs some;
  for (std::size_t k = 0; k < pairs.size(); k += step) some.push_back(pairs[k]);
  return some;
}

void follow(const BroadPhase::Config& config, std::uint32_t n) {
  Follower follower(config, n);
  ASSERT_TRUE(follower.agrees());
  const Pairs all = follower.pairs();
  ASSERT_GT(all.size(), n / 4);
  follower.exclude(every(2, all));
  ASSERT_TRUE(follower.agrees()) << "some pairs that are known";
  follower.advance(1);
  ASSERT_TRUE(follower.agrees()) << "while all move";
  follower.exclude(every(3, all));
  follower.advance(20);
  ASSERT_TRUE(follower.agrees()) << "others, while some move";
  follower.advance(20);
  ASSERT_TRUE(follower.agrees()) << "while some move";
  follower.exclude(all_pairs(std::min(n, 300U)));
  ASSERT_TRUE(follower.agrees()) << "all of the first";
  follower.exclude({});
  ASSERT_TRUE(follower.agrees()) << "none";
}

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_P(EachAlgorithm, SmallExclusionsAreNotReported) {
  follow(config(), 60);
}

TEST_P(EachAlgorithm, ExclusionsAreNotReported) {
  follow(config(), 1500);
}

TEST_P(EachAlgorithm, ExclusionsHoldForIds) {
  BroadPhase broad_phase(config());
  broad_phase.set_exclusions(Pairs{{2, 0}, {7, 900}});
  for (int k = 0; k < 3; ++k) broad_phase.add(unit);
  EXPECT_EQ(to_vector(broad_phase.update().added), (Pairs{{0, 1}, {1, 2}}));
  broad_phase.remove(2);
  EXPECT_EQ(broad_phase.add(unit), 2U);
  EXPECT_TRUE(same(broad_phase.update(), Pairs{{1, 2}}, Pairs{{1, 2}}));
  // Those that are set while an update runs belong to the next one.
  broad_phase.move(0, apart(0));
  broad_phase.begin();
  broad_phase.set_exclusions(Pairs{{0, 1}, {0, 1}});
  EXPECT_TRUE(same(broad_phase.finish(), Pairs{}, Pairs{}));
  EXPECT_TRUE(same(broad_phase.update(), Pairs{{0, 2}}, Pairs{{0, 1}}));
}

TEST(Exclusions, APairOfAnIdWithItselfIsRefused) {
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  broad_phase.set_exclusions(Pairs{{0, 1}});
  EXPECT_THAT(error_of([&] {
                broad_phase.set_exclusions(Pairs{{0, 2}, {3, 3}});
              }),
              ::testing::HasSubstr("an exclusion is of 3 and itself"));
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
              ::testing::HasSubstr("5 labels are not 2 for each object"));
  EXPECT_THAT(error_of([] { (void)pairs_that_share(std::vector<std::uint32_t>(5), 0); }),
              ::testing::HasSubstr("5 labels are not 0"));
}

}  // namespace
}  // namespace broadcl::test
