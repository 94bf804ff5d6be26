#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "base/two_sets.hpp"
#include "device_twins.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"
#include "twins.hpp"

/// Two sets of boxes: each pair has one of each.
namespace broadcl::test {
namespace {

using scenes::MovingBoxes;
using ::testing::HasSubstr;

Pairs expected_pairs(std::span<const Aabb> first, std::span<const Aabb> second) {
  Pairs pairs;
  for (std::uint32_t b = 0; b < second.size(); ++b) {
    for (std::uint32_t a = 0; a < first.size(); ++a) {
      if (overlaps(first[a], second[b])) pairs.push_back({a, b});
    }
  }
  return pairs;
}

/// Two sets in the same space.
struct SceneOfSets {
  SceneOfSets(std::uint32_t first_count, std::uint32_t second_count)
      : motion(first_count + second_count, MovingBoxes::Sizes::mixed), count(first_count) {}

  [[nodiscard]] std::vector<Aabb> first() const { return boxes(0, count); }
  [[nodiscard]] std::vector<Aabb> second() const { return boxes(count, motion.boxes().size()); }
  [[nodiscard]] std::vector<Aabb> boxes(std::size_t begin, std::size_t end) const {
    const auto all = motion.boxes();
    return {all.begin() + static_cast<std::ptrdiff_t>(begin), all.begin() + static_cast<std::ptrdiff_t>(end)};
  }

  MovingBoxes motion;
  std::size_t count;
};

void expect_pairs(const BroadPhase::Config& config, std::uint32_t first_count, std::uint32_t second_count) {
  SCOPED_TRACE(std::to_string(first_count) + " and " + std::to_string(second_count));
  const SceneOfSets scene(first_count, second_count);
  const std::vector<Aabb> first = scene.first();
  const std::vector<Aabb> second = scene.second();
  EXPECT_TRUE(same("pairs", overlapping_pairs(first, second, {}, config), expected_pairs(first, second)));
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallTwoSetsAtOnce) {
  for (const auto& [first, second] : {std::pair(0U, 0U), {0U, 9U}, {9U, 0U}, {1U, 1U}, {40U, 60U}}) {
    expect_pairs(config(), first, second);
  }
}

NOT_IN(sanitizers, "takes long; smaller ones are in it");
TEST_P(EachAlgorithm, TwoSetsAtOnce) {
  for (const auto& [first, second] : {std::pair(1000U, 31U), {33U, 2000U}, {1500U, 1500U}}) {
    expect_pairs(config(), first, second);
  }
}

TEST_P(EachAlgorithm, TwoSetsInTwoDimensionsAndDoublePrecision) {
  const std::array<double, 8> first{0, 0, 1, 1, 5, 5, 6, 6};
  const std::array<float, 8> second{1, 1, 2, 2, 5.5F, 0, 6, 5};
  EXPECT_EQ(overlapping_pairs(BoxView::rectangles(first.data(), 2), BoxView::rectangles(second.data(), 2), {},
                              config()),
            (Pairs{{0, 0}, {1, 1}}));
}

TEST_P(EachAlgorithm, OfTwoSetsAnErrorSaysWhichOneHasANaN) {
  std::vector<Aabb> boxes(3, unit);
  const std::vector<Aabb> good(2, unit);
  boxes[1].lower[0] = nan_value;
  EXPECT_THAT(error_of([&] { (void)overlapping_pairs(boxes, good, {}, config()); }),
              HasSubstr("the first set: box 1 has a NaN"));
  EXPECT_THAT(error_of([&] { (void)overlapping_pairs(good, boxes, {}, config()); }),
              HasSubstr("the second set: box 1 has a NaN"));
}

/// World numbers that floats and shifted words cannot tell apart.
TEST_P(EachAlgorithm, TwoSetsInWorldsOfLargeNumbers) {
  Twins twins(config());
  for (const std::uint32_t world : {0U, 8'388'606U, 8'388'607U, 8'388'608U, 16'777'217U, 0x7ffffffeU,
                                    0x7fffffffU, 0x80000000U, 0xfffffffeU, Filter::all_worlds}) {
    for (const Filter& set : {Filter::first_set, Filter::second_set, Filter::first_set}) {
      twins.add(unit, {.group = set.group, .mask = set.mask, .world = world});
    }
  }
  ASSERT_TRUE(twins.agree());
  EXPECT_EQ(twins.tested().pairs().size(), 9U * (2 + 2 + 2) + 2);
}

TEST(TwoSets, DecideIfEveryTwoObjectsOfDifferentSetsMayPair) {
  const auto decide = [](std::initializer_list<Filter> filters) {
    TwoSets sets;
    for (const Filter& filter : filters) sets.add(filter);
    return sets.decide();
  };
  const auto in = [](Filter set, std::uint32_t world) {
    set.world = world;
    return set;
  };
  const auto of = [](Filter set, std::uint32_t body) {
    set.body = body;
    return set;
  };
  EXPECT_TRUE(decide({Filter::first_set, Filter::second_set, Filter::first_set}));
  EXPECT_TRUE(decide({in(Filter::first_set, 3), in(Filter::second_set, 3)}));
  EXPECT_TRUE(decide({of(Filter::first_set, 3), of(Filter::second_set, 4)}));
  EXPECT_FALSE(decide({in(Filter::first_set, 3), in(Filter::second_set, 4)}));
  EXPECT_FALSE(
      decide({in(Filter::first_set, Filter::all_worlds), in(Filter::second_set, Filter::all_worlds)}));
  EXPECT_FALSE(decide({of(Filter::first_set, 3), of(Filter::second_set, 3)}));
  EXPECT_FALSE(decide({Filter::first_set, Filter::second_set, of(Filter::second_set, 3)}));
  EXPECT_FALSE(decide({{.group = 0, .mask = 1}, Filter::first_set, Filter::second_set}));
  EXPECT_FALSE(decide({Filter::first_set, {.group = 4, .mask = 0}}));
}

TEST(TwoSets, AreApartIfNothingPairsInside) {
  const auto are_apart = [](std::initializer_list<Filter> filters) {
    TwoSets sets;
    for (const Filter& filter : filters) sets.add(filter);
    return sets.are_apart();
  };
  EXPECT_TRUE(are_apart({}));
  EXPECT_TRUE(are_apart({Filter::first_set, Filter::second_set, Filter::first_set}));
  EXPECT_TRUE(are_apart({Filter::first_set, {.group = 4, .mask = 0}}));
  EXPECT_FALSE(are_apart({Filter::first_set, Filter()}));
  EXPECT_FALSE(are_apart({Filter::second_set, {.group = 4, .mask = 2}}));
}

/// In any order, as if they had been added just now.
TEST(TwoSets, AreThoseOfTheFiltersThatAreThere) {
  const std::array kinds{Filter::first_set,
                         Filter::second_set,
                         Filter(),
                         Filter{.group = 4, .mask = 0},
                         Filter{.group = 1, .mask = 2, .body = 7},
                         Filter{.group = 2, .mask = 1, .world = 0x80000000},
                         Filter{.group = 0xffffffff, .mask = 0xfffffffe, .world = Filter::all_worlds}};
  std::array<std::uint32_t, kinds.size()> counts{};
  TwoSets sets;
  std::uint32_t random = 1;
  const auto below = [&](std::uint32_t n) { return (random = random * 1664525 + 1013904223) / 65536 % n; };
  std::size_t apart = 0;
  std::size_t decided = 0;
  for (int step = 0; step < 20000; ++step) {
    // Few kinds most of the time, and now and then a lot of one kind.
    const std::uint32_t kind = step % 1000 < 500 ? below(2) : below(kinds.size());
    if (step % 500 >= 250 && counts[kind] > 0) {
      for (; counts[kind] > 0; --counts[kind]) sets.remove(kinds[kind]);
    } else {
      const std::uint32_t more = 1 + below(40);
      for (std::uint32_t k = 0; k < more; ++k) sets.add(kinds[kind]);
      counts[kind] += more;
    }
    TwoSets expected;
    for (std::size_t k = 0; k < kinds.size(); ++k) {
      if (counts[k] > 0) expected.add(kinds[k]);
    }
    ASSERT_EQ(sets.are_apart(), expected.are_apart()) << step;
    ASSERT_EQ(sets.decide(), expected.decide()) << step;
    apart += sets.are_apart() ? 1U : 0U;
    decided += sets.are_apart() && sets.decide() ? 1U : 0U;
  }
  EXPECT_GT(apart, 100U);
  EXPECT_GT(decided, 100U);
}

class TwoSetsOnTheDevice : public ::testing::TestWithParam<std::string> {
 protected:
  /// Waits for some updates only.
  void follow(std::uint32_t first_count, std::uint32_t second_count) {
    SceneOfSets scene(first_count, second_count);
    DeviceTwins twins(queue_, {.algorithm = GetParam()});
    twins.reserve(first_count + second_count, 50'000);
    for (int frame = 0; frame < 6; ++frame) {
      const DeviceFrame now{
          .boxes = scene.boxes(0, first_count + second_count), .first_count = first_count, .gap = 2};
      if (frame % 3 == 0) {
        ASSERT_TRUE(twins.update(now)) << "frame " << frame;
      } else {
        twins.enqueue(now, 20'000);
        ASSERT_FALSE(twins.is_halted());
        ASSERT_TRUE(twins.agree()) << "frame " << frame;
      }
      for (int k = 0; k < 5; ++k) scene.motion.advance();
    }
  }

  const CallersQueue queue_;
};

SUITE_ALSO_IN(TwoSetsOnTheDevice, gpu_profile | rusticl);

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_P(TwoSetsOnTheDevice, SmallSetsHaveTheirPairs) {
  follow(30, 50);
}

TEST_P(TwoSetsOnTheDevice, SetsHaveTheirPairs) {
  follow(700, 900);
}

/// More changes than expected, and one box with so many that they are sorted in another way.
NOT_IN(rusticl, "takes long");
TEST_P(TwoSetsOnTheDevice, ManyPairsOfABox) {
  const std::vector<Aabb> first(6000, unit);
  const std::vector<Aabb> second{unit, inverted, unit};
  const cl::Buffer first_buffer = queue_.buffer_of(first);
  const cl::Buffer second_buffer = queue_.buffer_of(second);
  DeviceBroadPhase broad_phase(queue_(), {.algorithm = GetParam()});
  const auto result = broad_phase.update({.buffer = first_buffer(),
                                          .count = first.size(),
                                          .second = {.buffer = second_buffer(), .count = second.size()}});
  EXPECT_TRUE(same("added", queue_.read(result.added), expected_pairs(first, second)));
}

TEST_P(TwoSetsOnTheDevice, BadSetsAreRefused) {
  const cl::Buffer boxes = queue_.buffer_of(std::vector<Aabb>(4, unit));
  DeviceBroadPhase broad_phase(queue_(), {.algorithm = GetParam()});
  DeviceBroadPhase::Boxes given{.buffer = boxes(), .count = 4, .second = {.count = 1}};
  EXPECT_THAT(error_of([&] { (void)broad_phase.update(given); }),
              HasSubstr("the buffer of the second set is null"));
  given.second.buffer = boxes();
  given.second.count = 5;
  EXPECT_THAT(error_of([&] { (void)broad_phase.update(given); }), HasSubstr("too few for 5"));
  given.second.count = 4;
  given.second.offset = 2;
  EXPECT_THAT(error_of([&] { (void)broad_phase.update(given); }),
              HasSubstr("offset and stride of the second set must be multiples of 4"));
  given.second.offset = 0;
  EXPECT_EQ(broad_phase.update(given).pair_count, 16U);
  given.count = 3;
  EXPECT_THAT(error_of([&] { (void)broad_phase.update(given); }),
              HasSubstr("must be the same in every update"));
  given.count = 4;
  given.second.count = 2;
  EXPECT_EQ(broad_phase.update(given).removed.count, 8U);
}

INSTANTIATE_TEST_SUITE_P(Algorithms, TwoSetsOnTheDevice, ::testing::Values("auto", "brute-force", "tiles"),
                         named_by_parameter);

}  // namespace
}  // namespace broadcl::test
