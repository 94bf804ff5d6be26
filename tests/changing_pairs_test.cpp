#include "engines/changing_pairs.hpp"

#include <cstdint>
#include <random>
#include <set>
#include <vector>

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace broadcl::test
