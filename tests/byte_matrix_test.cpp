#include "finders/byte_matrix.hpp"

#include <algorithm>
#include <iterator>
#include <random>
#include <set>

#include <gtest/gtest.h>

#include "finders/triangle.hpp"

namespace broadcl {
namespace {

std::vector<std::byte> random_bytes(std::uint32_t n, double density, std::mt19937& random) {
  std::vector<std::byte> bytes(triangle::row_start(n));
  std::bernoulli_distribution hit(density);
  std::generate(bytes.begin(), bytes.end(), [&] { return std::byte{hit(random)}; });
  return bytes;
}

std::set<Pair> pairs_of(const std::vector<std::byte>& bytes) {
  std::set<Pair> pairs;
  std::size_t index = 0;
  for (std::uint32_t b = 1; index < bytes.size(); ++b) {
    for (std::uint32_t a = 0; a < b; ++a, ++index) {
      if (bytes[index] != std::byte{0}) pairs.insert({a, b});
    }
  }
  return pairs;
}

void check(const std::vector<std::byte>& previous, const std::vector<std::byte>& current,
           const std::vector<std::uint32_t>& recycled) {
  std::vector<Pair> added{{7, 8}};
  std::vector<Pair> removed{{7, 8}};
  find_changes(previous, current, recycled, added, removed);

  const std::set<Pair> before = pairs_of(previous);
  const std::set<Pair> now = pairs_of(current);
  std::vector<Pair> kept;
  std::copy_if(before.begin(), before.end(), std::back_inserter(kept), [&](const Pair& pair) {
    return now.contains(pair) && std::find(recycled.begin(), recycled.end(), pair.a) == recycled.end() &&
           std::find(recycled.begin(), recycled.end(), pair.b) == recycled.end();
  });
  std::vector<Pair> expected;
  std::set_difference(now.begin(), now.end(), kept.begin(), kept.end(), std::back_inserter(expected));
  EXPECT_EQ(added, expected);
  expected.clear();
  std::set_difference(before.begin(), before.end(), kept.begin(), kept.end(), std::back_inserter(expected));
  EXPECT_EQ(removed, expected);
}

TEST(ByteMatrix, ChangesAreThoseOfTheSets) {
  std::mt19937 random(1);
  for (const double density : {0.0, 0.002, 0.3, 1.0}) {
    for (const std::uint32_t n : {0U, 1U, 2U, 3U, 12U, 16U, 40U, 100U}) {
      const auto previous = random_bytes(n, density, random);
      check(previous, previous, {});
      check(previous, random_bytes(n, density, random), {});
      check(previous, {}, {});
      check({}, previous, {});
    }
  }
}

TEST(ByteMatrix, FramesMayDifferInSize) {
  std::mt19937 random(2);
  for (const std::uint32_t n : {2U, 12U, 50U, 51U}) {
    for (const std::uint32_t m : {0U, 1U, 3U, 49U, 50U, 90U}) {
      check(random_bytes(n, 0.1, random), random_bytes(m, 0.1, random), {});
    }
  }
}

TEST(ByteMatrix, PairsOfRecycledSlotsAreOtherPairs) {
  std::mt19937 random(3);
  const auto previous = random_bytes(60, 0.1, random);
  const auto current = random_bytes(64, 0.1, random);
  check(previous, previous, {0});
  check(previous, previous, {59});
  check(previous, current, {0, 1, 30, 59, 63});
}

}  // namespace
}  // namespace broadcl
