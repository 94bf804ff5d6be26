// Lists of pairs that change, and how they are compared.
#include "engines/changing_pairs.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>
#include <random>
#include <set>
#include <vector>

#include <gtest/gtest.h>

#include "base/pair_lists.hpp"
#include "core/pair_index.hpp"
#include "runs.hpp"

namespace broadcl::test {
namespace {

/// Random changes of none to many pairs, some of which are removed and added by the same change.
TEST(ChangingPairs, AreThoseOfASet) {
  std::mt19937 random(1);
  const auto below = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
  std::set<Pair> expected;
  std::vector<Pair> first;
  for (std::uint32_t a = 0; a < 1000; ++a) first.push_back({a, a + 1});
  expected.insert(first.begin(), first.end());
  ChangingPairs pairs;
  pairs.swap(first);
  for (int change = 0; change < 2000; ++change) {
    std::set<Pair> added;
    std::set<Pair> removed;
    for (std::uint32_t k = below(below(20) == 0 ? 200 : 6); k > 0; --k) {
      const std::uint32_t a = below(1000);
      const Pair pair{a, a + 1 + below(2)};
      if (!expected.contains(pair) || below(4) == 0) added.insert(pair);
      if (expected.contains(pair)) removed.insert(pair);
    }
    pairs.change(std::vector(added.begin(), added.end()), std::vector(removed.begin(), removed.end()));
    for (const Pair& pair : removed) expected.erase(pair);
    expected.insert(added.begin(), added.end());
    ASSERT_EQ(pairs.size(), expected.size()) << change;
    if (below(16) == 0) {
      ASSERT_EQ(pairs.all(), std::vector(expected.begin(), expected.end())) << change;
    }
  }
}

TEST(PairIndex, IsASetOfPairsThatSlotsAreLookedUpIn) {
  std::mt19937 random(1);
  std::set<Pair> expected;
  PairIndex index;
  for (int change = 0; change < 3000; ++change) {
    const auto slots = static_cast<std::uint32_t>(20 + change / 100);
    const auto slot = [&] { return static_cast<std::uint32_t>(random() % slots); };
    const std::vector some{slot(), slot(), slot(), slot()};
    const auto is_of_some = [&](const Pair& pair) {
      return std::ranges::count(some, pair.a) + std::ranges::count(some, pair.b) > 0;
    };
    std::vector<Pair> found;
    std::ranges::copy_if(expected, std::back_inserter(found), is_of_some);
    ASSERT_EQ(index.of(some), found) << change;
    if (random() % 500 == 0) {
      index.clear();
      expected.clear();
    } else if (random() % 2 == 0) {
      for (const Pair& pair : found) index.erase(pair);
      std::erase_if(expected, is_of_some);
    }
    std::set<Pair> more;
    for (auto k = random() % 20; k > 0; --k) {
      const std::uint32_t b = 1 + static_cast<std::uint32_t>(random() % (slots - 1));
      const Pair pair{slot() % b, b};
      if (!expected.contains(pair)) more.insert(pair);
    }
    index.reserve(more.size(), slots);
    for (const Pair& pair : more) index.insert(pair);
    expected.insert(more.begin(), more.end());
    ASSERT_EQ(index.size(), expected.size()) << change;
    ASSERT_EQ(index.all(), std::vector(expected.begin(), expected.end())) << change;
  }
}

TEST(PairLists, CompareByPartsAndByTheDefinition) {
  std::mt19937 random(1);
  const auto list = [&](std::uint32_t n, unsigned of_ten) {
    std::vector<Pair> pairs;
    for (std::uint32_t b = 1; b < n; ++b) {
      for (std::uint32_t a = b < 6 ? 0 : b - 6; a < b; ++a) {
        if (random() % 10 < of_ten) pairs.push_back({a, b});
      }
    }
    return pairs;
  };
  std::vector<std::uint32_t> often;
  for (std::uint32_t slot = 0; slot < 10'000; slot += 1 + slot * slot % 5) often.push_back(slot);
  const std::array lists{list(10'000, 9), list(10'000, 8), list(2000, 10), list(10, 5), std::vector<Pair>{}};
  PairParts one(1);
  PairParts four(4);
  for (const std::vector<std::uint32_t>& recycled :
       {std::vector<std::uint32_t>{}, {7}, {7, 500, 501, 4000, 9999}, often}) {
    const auto is_recycled = [&](const Pair& pair) {
      return std::ranges::binary_search(recycled, pair.a) || std::ranges::binary_search(recycled, pair.b);
    };
    const auto expected = [&](const std::vector<Pair>& in, const std::vector<Pair>& other) {
      std::vector<Pair> pairs;
      std::ranges::copy_if(in, std::back_inserter(pairs), [&](const Pair& pair) {
        return is_recycled(pair) || !std::ranges::binary_search(other, pair);
      });
      return pairs;
    };
    for (const std::vector<Pair>& before : lists) {
      for (const std::vector<Pair>& now : lists) {
        for (PairParts* const parts : {&one, &four}) {
          std::vector<Pair> added, removed;
          compare(before, now, recycled, *parts, added, removed);
          EXPECT_EQ(added, expected(now, before)) << before.size() << ", " << now.size();
          EXPECT_EQ(removed, expected(before, now)) << before.size() << ", " << now.size();
        }
      }
    }
  }
}

}  // namespace
}  // namespace broadcl::test
