#include <broadcl/filter.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <span>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "rounding.hpp"
#include "twins.hpp"

namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

constexpr Filter in_world(std::uint32_t world) {
  return {.world = world};
}
constexpr Filter of_body(std::uint32_t body) {
  return {.body = body};
}

TEST(Filter, PairsNeedBothMasksOneWorldAndTwoBodies) {
  constexpr Filter one{.group = 1, .mask = 2};
  constexpr Filter two{.group = 2, .mask = 1};
  static_assert(may_pair(one, two));
  EXPECT_TRUE(may_pair(two, one));
  EXPECT_FALSE(may_pair(one, one));
  EXPECT_FALSE(may_pair(two, two));
  EXPECT_FALSE(may_pair({.group = 1, .mask = 2}, {.group = 2, .mask = 2}));
  EXPECT_TRUE(may_pair({}, {}));
  EXPECT_FALSE(may_pair(in_world(1), {}));
  EXPECT_TRUE(may_pair(in_world(1), in_world(1)));
  EXPECT_TRUE(may_pair(in_world(Filter::all_worlds), in_world(1)));
  EXPECT_TRUE(may_pair({}, in_world(Filter::all_worlds)));
  EXPECT_TRUE(may_pair(in_world(Filter::all_worlds), in_world(Filter::all_worlds)));
  EXPECT_FALSE(may_pair(of_body(0), of_body(0)));
  EXPECT_TRUE(may_pair(of_body(0), of_body(1)));
  EXPECT_TRUE(may_pair(of_body(Filter::no_body), of_body(Filter::no_body)));
}

/// Whether two layers pair, for up to 99 layers.
bool random_pairs(std::size_t a, std::size_t b) {
  return (std::minmax(a, b).first * 31 + std::max(a, b) * 17) % 7 < 3;
}

template <class Rule>
void expect_rule(const std::vector<Filter>& filters, const Rule& rule) {
  for (std::size_t a = 0; a < filters.size(); ++a) {
    for (std::size_t b = 0; b < filters.size(); ++b) {
      ASSERT_EQ(may_pair(filters[a], filters[b]), rule(a, b)) << a << " and " << b;
    }
  }
}

TEST(Filter, OfLayersFollowTheRule) {
  EXPECT_TRUE(filters_from_layers(0, random_pairs).empty());
  for (const std::size_t layers : {1U, 2U, 31U, 32U}) {
    const std::vector<Filter> filters = filters_from_layers(layers, random_pairs);
    ASSERT_EQ(filters.size(), layers);
    expect_rule(filters, random_pairs);
    for (std::size_t k = 0; k < layers; ++k) EXPECT_EQ(filters[k].group, 1U << k);
  }
}

TEST(Filter, OfManyLayersShareGroups) {
  const auto rule = [](std::size_t a, std::size_t b) { return random_pairs(a % 32, b % 32); };
  const std::vector<Filter> filters = filters_from_layers(100, rule);
  expect_rule(filters, rule);
  EXPECT_EQ(filters[0], filters[32]);
}

TEST(Filter, OfLayersThatDoNotFitAreRefused) {
  EXPECT_THAT(error_of([] {
                (void)filters_from_layers(9, [](std::size_t a, std::size_t b) { return a == 2 && b == 5; });
              }),
              HasSubstr("layers 2 and 5 pair in one direction only"));
  const auto others = [](std::size_t a, std::size_t b) { return a != b; };
  EXPECT_EQ(filters_from_layers(32, others).size(), 32U);
  EXPECT_THAT(error_of([&] { (void)filters_from_layers(33, others); }), HasSubstr("more than 32 kinds"));
}

TEST(Filter, OfOneSidedRulesNeedOneDirection) {
  std::vector<std::uint32_t> types;
  std::vector<std::uint32_t> affinities;
  const auto rule = [&](std::size_t a, std::size_t b) {
    return ((types[a] & affinities[b]) | (types[b] & affinities[a])) != 0;
  };
  for (std::uint32_t k = 0; k < 200; ++k) {
    types.push_back(k % 3 << 30U);
    affinities.push_back(k * k % 4 << 29U);
  }
  const std::vector<Filter> filters = filters_from_one_sided(types, affinities);
  ASSERT_EQ(filters.size(), 200U);
  expect_rule(filters, rule);

  // More than 32 combinations, which differ in what has no effect.
  for (std::uint32_t k = 0; k < 200; ++k) types[k] |= k << 3U;
  expect_rule(filters_from_one_sided(types, affinities), rule);

  for (std::uint32_t k = 0; k < 200; ++k) affinities[k] |= k << 3U;
  EXPECT_THAT(error_of([&] { (void)filters_from_one_sided(types, affinities); }),
              HasSubstr("more than 32 kinds"));
  types.pop_back();
  EXPECT_THAT(error_of([&] { (void)filters_from_one_sided(types, affinities); }),
              HasSubstr("199 types and 200 affinities"));
}

/// Boxes that all lie in the same place, with the given filters: the pairs must be the expected ones, and the
/// oracle's.
void expect_pairs(const BroadPhase::Config& config, std::span<const Filter> filters, const Pairs& expected) {
  Twins twins(config);
  for (const Filter& filter : filters) twins.add(unit, filter);
  ASSERT_TRUE(twins.agree());
  EXPECT_EQ(twins.tested().pairs(), expected);
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallGroupsAndMasksFilterBothWays) {
  constexpr std::uint32_t high = 0x80000000;
  constexpr std::array filters{Filter{.group = 1},
                               Filter{.group = 2, .mask = 1},
                               Filter{.group = 2, .mask = 2},
                               Filter{.group = 1, .mask = 0},
                               Filter{.group = 0},
                               Filter{.group = high, .mask = high | 1},
                               Filter{.group = high | 1, .mask = high},
                               Filter{.group = 2, .mask = 2}};
  expect_pairs(config(), filters, {{0, 1}, {0, 5}, {5, 6}, {2, 7}});
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallObjectsOfABodyNeverPair) {
  constexpr std::array filters{of_body(7), of_body(7), of_body(8), Filter{},
                               Filter{},   of_body(0), of_body(0)};
  Pairs expected = all_pairs(filters.size());
  std::erase(expected, Pair{0, 1});
  std::erase(expected, Pair{5, 6});
  expect_pairs(config(), filters, expected);
}

/// Worlds are compared bit by bit, although kernels store them among floats. As floats, those here would be
/// zeros, denormals, infinities and NaNs.
ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_P(EachAlgorithm, SmallWorldsAreComparedBitByBit) {
  constexpr std::array<std::uint32_t, 9> worlds{0,          1,          2,          0x7f800000, 0x7f800001,
                                                0x7fc00000, 0x80000000, 0x80000001, 0xfffffffe};
  std::vector<Filter> filters;
  Pairs expected;
  for (std::uint32_t k = 0; k < 2 * worlds.size(); ++k) {
    filters.push_back(in_world(worlds[k % worlds.size()]));
    if (k >= worlds.size()) expected.push_back({k - std::uint32_t{worlds.size()}, k});
  }
  expect_pairs(config(), filters, expected);
}

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_P(EachAlgorithm, SmallObjectsOfAllWorldsPairWithEachOtherOnce) {
  Twins twins({.algorithm = std::string(GetParam().name)});
  for (const std::uint32_t world : {0U, 1U, Filter::all_worlds, 1U, Filter::all_worlds}) {
    twins.add(unit, {.world = world});
  }
  ASSERT_TRUE(twins.agree());
  EXPECT_EQ(twins.tested().pairs(), (Pairs{{0, 2}, {1, 2}, {1, 3}, {2, 3}, {0, 4}, {1, 4}, {2, 4}, {3, 4}}));
  twins.set_filter(2, {.world = 1});
  ASSERT_TRUE(twins.agree());
  EXPECT_EQ(twins.tested().pairs(), (Pairs{{1, 2}, {1, 3}, {2, 3}, {0, 4}, {1, 4}, {2, 4}, {3, 4}}));
}

/// Many small worlds in one search, all in the same place: interleaved, so that each vector of boxes holds
/// many worlds, and in blocks.
NOT_IN(gpu_profile | rusticl | sanitizers, "takes long");
TEST_P(EachAlgorithm, ThousandsOfWorldsInOneSearch) {
  constexpr std::uint32_t size = 20;
  const std::uint32_t worlds = is_slow() ? 100 : 300;
  for (const bool interleaved : {true, false}) {
    BroadPhase broad_phase(config());
    Pairs expected;
    const auto world_of = [&](std::uint32_t id) { return interleaved ? id % worlds : id / size; };
    for (std::uint32_t b = 0; b < worlds * size; ++b) {
      broad_phase.add(unit, in_world(world_of(b)));
      const std::uint32_t step = interleaved ? worlds : 1;
      for (std::uint32_t a = interleaved ? b % worlds : b / size * size; a < b; a += step) {
        expected.push_back({a, b});
      }
    }
    ASSERT_EQ(expected.size(), worlds * (size * (size - 1) / 2));
    ASSERT_TRUE(same(broad_phase.update(), expected, {}));
    // One object moves to another world.
    Pairs of_0;
    Pairs of_new;
    std::copy_if(expected.begin(), expected.end(), std::back_inserter(of_0),
                 [](const Pair& pair) { return pair.a == 0; });
    for (std::uint32_t b = 1; b < worlds * size; ++b) {
      if (world_of(b) == worlds - 1) of_new.push_back({0, b});
    }
    broad_phase.set_filter(0, in_world(worlds - 1));
    ASSERT_TRUE(same(broad_phase.update(), of_new, of_0));
  }
}

/// Only one of 40 objects moves, after the mode has changed.
TEST_P(EachAlgorithm, SmallAnUpdateInAnotherRoundingMode) {
  for (const std::uint32_t world : {(1U << 24U) + 1, (1U << 24U) + 3, 0x80000001U, 0xfffffffeU}) {
    Twins twins(config());
    for (int k = 0; k < 40; ++k) twins.add(unit, in_world(world));
    ASSERT_TRUE(twins.agree());
    for (const int mode : rounding_modes) {
      const ScopedRounding rounding(mode);
      twins.move(7, {{0, 0, 0}, {1, 1, 2 + static_cast<float>(mode)}});
      ASSERT_TRUE(twins.agree());
      EXPECT_EQ(twins.tested().pairs().size(), 780U) << world;
    }
  }
}

}  // namespace
}  // namespace broadcl::test
