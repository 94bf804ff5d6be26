#include "finders/triangle.hpp"

#include <cstddef>
#include <vector>

#include <gtest/gtest.h>

namespace broadcl::triangle {
namespace {

TEST(Triangle, IndexIsDenseForEveryPair) {
  ulong expected = 0;
  for (uint b = 0; b < 300; ++b) {
    for (uint a = 0; a < b; ++a) ASSERT_EQ(row_start(b) + a, expected++);
  }
}

TEST(Triangle, IndexPasses32Bits) {
  EXPECT_EQ(row_start(92'682), 4'294'930'221U);
  EXPECT_EQ(row_start(92'683), 4'295'022'903U);
  EXPECT_EQ(row_start(0xffffffffU), 9'223'372'030'412'324'865U);
}

class TriangleWords : public ::testing::TestWithParam<uint> {};

TEST_P(TriangleWords, RowStartsRecurWithAPeriodOfTwoWords) {
  const uint width = GetParam();
  for (const uint first : {0U, 92'600U, 0xffff0000U}) {
    for (uint b = first; b < first + 200; ++b) EXPECT_EQ(row_head(b, width), row_head(b + 2 * width, width));
  }
}

/// Counts how often each word is stored: it must be once, by a row's whole words or by a seam.
TEST_P(TriangleWords, EveryByteIsStoredOnce) {
  const uint width = GetParam();
  for (uint n = 0; n < 150; ++n) {
    const std::size_t words = (row_start(n) + width - 1) / width;
    std::vector<int> stores(words, 0);
    for (uint b = 0; b < n; ++b) {
      for (ulong a = row_head(b, width); a + width <= b; a += width) {
        ASSERT_EQ((row_start(b) + a) % width, 0U);
        ++stores[(row_start(b) + a) / width];
      }
    }
    for (uint b = 1; b <= n; ++b) {
      if (owns_seam(b, width)) ++stores[row_start(b) / width];
    }
    EXPECT_EQ(stores, std::vector<int>(words, 1)) << "n = " << n;
  }
}

/// The same at the end of a triangle whose index is past 32 bits: the words of row b and the seams at both
/// its ends tile it without a gap.
TEST_P(TriangleWords, RowsPast32BitsAreTiledToo) {
  const uint width = GetParam();
  for (uint b = 92'670; b < 92'670 + 4 * width; ++b) {
    const ulong head = row_head(b, width);
    const ulong whole_end = row_start(b) + head + (b - head) / width * width;
    EXPECT_EQ(owns_seam(b, width), head != 0);
    EXPECT_EQ(row_start(b + 1) - whole_end, row_start(b + 1) % width);
  }
}

INSTANTIATE_TEST_SUITE_P(Width, TriangleWords, ::testing::Values(4U, 8U, 16U),
                         ::testing::PrintToStringParamName());

}  // namespace
}  // namespace broadcl::triangle
