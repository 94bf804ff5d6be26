#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/eigen.hpp>

#include "base/packed_box.hpp"
#include "boxes.hpp"
#include "fast_math.hpp"
#include "rounding.hpp"

namespace broadcl {
namespace {

using test::infinity;
using test::nan_value;
using test::unit;

TEST(Aabb, TouchingBoxesOverlap) {
  EXPECT_TRUE(overlaps(unit, {{1, 1, 1}, {2, 2, 2}}));
  EXPECT_TRUE(overlaps(unit, {{-1, 0, 0}, {0, 1, 1}}));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    Aabb apart{{1, 1, 1}, {2, 2, 2}};
    apart.lower[axis] = std::nextafter(1.0F, 2.0F);
    EXPECT_FALSE(overlaps(unit, apart)) << axis;
    EXPECT_FALSE(overlaps(apart, unit)) << axis;
  }
}

TEST(Aabb, InfiniteBoundsAndSignedZerosAreOrdinaryNumbers) {
  EXPECT_TRUE(overlaps(unit, {{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}}));
  EXPECT_TRUE(overlaps(unit, {{-1, -1, -1}, {-0.0F, -0.0F, -0.0F}}));
}

TEST(Aabb, EmptyBoxesAreInvertedOrNaN) {
  EXPECT_FALSE(is_empty(unit));
  EXPECT_FALSE(is_empty({{1, 1, 1}, {1, 1, 1}}));
  EXPECT_TRUE(is_empty({{0, 2, 0}, {1, 1, 1}}));
  EXPECT_TRUE(is_empty({{0, 0, 0}, {1, 1, nan_value}}));
  EXPECT_TRUE(is_empty(packed_empty()));
}

TEST(Aabb, EmptyBoxesOverlapNothingNotEvenInfiniteBoxes) {
  constexpr Aabb all{{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}};
  EXPECT_TRUE(overlaps(all, all));
  EXPECT_EQ(empty_aabb(), (Aabb{all.upper, all.lower}));
  for (const Aabb& empty : {empty_aabb(), packed_empty(), Aabb{{0, 2, 0}, {1, 1, 1}},
                            Aabb{{0, 0, infinity}, {1, 1, -infinity}}, Aabb{{0, 0, 0}, {1, nan_value, 1}}}) {
    EXPECT_TRUE(is_empty(empty));
    for (const Aabb& other : {all, unit, empty}) {
      EXPECT_FALSE(overlaps(empty, other));
      EXPECT_FALSE(overlaps(other, empty));
    }
  }
}

/// Boxes whose bounds are special numbers, most of them empty.
std::vector<Aabb> special_boxes() {
  constexpr float denormal = std::numeric_limits<float>::denorm_min();
  constexpr float largest = std::numeric_limits<float>::max();
  const std::array numbers{-nan_value, -infinity, -largest, -1.0F,   -denormal, -0.0F,
                           0.0F,       denormal,  1.0F,     largest, infinity,  nan_value};
  std::vector<Aabb> boxes;
  for (const float lower : numbers) {
    for (const float upper : numbers) {
      boxes.push_back({{0, lower, 0}, {1, upper, 1}});
      boxes.push_back({{lower, lower, lower}, {upper, upper, upper}});
    }
  }
  return boxes;
}

/// The expected answers, by floating-point comparisons.
test::Answers defined_answers(const Aabb& s, const Aabb& t) {
  const auto is_nan = [](float bound) { return std::isnan(bound); };
  return {.has_nan = std::ranges::any_of(s.lower, is_nan) || std::ranges::any_of(s.upper, is_nan),
          .is_empty = !packed_overlaps(s, s),
          .overlap = packed_overlaps(s, s) && packed_overlaps(t, t) && packed_overlaps(s, t)};
}

TEST(Aabb, SpecialNumbersAreJudgedAsDefinedEvenByConsumersWithFastMath) {
  const std::vector<Aabb> boxes = special_boxes();
  for (std::size_t s = 0; s < boxes.size(); ++s) {
    for (std::size_t t = 0; t < boxes.size(); ++t) {
      const test::Answers expected = defined_answers(boxes[s], boxes[t]);
      ASSERT_EQ(has_nan(boxes[s]), expected.has_nan) << s;
      ASSERT_EQ(is_empty(boxes[s]), expected.is_empty) << s;
      ASSERT_EQ(overlaps(boxes[s], boxes[t]), expected.overlap) << s << ", " << t;
      ASSERT_TRUE(test::fast_math_answers(boxes[s], boxes[t]) == expected) << s << ", " << t;
    }
  }
}

TEST(Aabb, PackingMakesEveryEmptyBoxTheSame) {
  for (const Aabb& box : special_boxes()) {
    using Bits = std::array<std::uint32_t, 6>;
    const Aabb expected = is_empty(box) ? packed_empty() : box;
    EXPECT_EQ(std::bit_cast<Bits>(pack(box)), std::bit_cast<Bits>(expected));
  }
}

TEST(Aabb, NaNIsFoundInEveryBound) {
  EXPECT_FALSE(has_nan(unit));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    Aabb box = unit;
    box.lower[axis] = nan_value;
    EXPECT_TRUE(has_nan(box));
    box = unit;
    box.upper[axis] = nan_value;
    EXPECT_TRUE(has_nan(box));
  }
}

TEST(Aabb, DoublesRoundOutward) {
  const Aabb box = round_outward({0.1, 1.0, -0.1}, {0.1, 1.0, -0.1});
  EXPECT_LT(static_cast<double>(box.lower[0]), 0.1);
  EXPECT_GT(static_cast<double>(box.upper[0]), 0.1);
  EXPECT_EQ(std::nextafter(box.lower[0], infinity), box.upper[0]);
  EXPECT_EQ(box.lower[1], 1.0F);
  EXPECT_EQ(box.upper[1], 1.0F);
  EXPECT_LT(static_cast<double>(box.lower[2]), -0.1);
  EXPECT_GT(static_cast<double>(box.upper[2]), -0.1);
}

TEST(Aabb, DoublesBeyondFloatStayOutside) {
  constexpr float largest = std::numeric_limits<float>::max();
  const Aabb box = round_outward({1e300, -1e300, 1e-300}, {1e300, -1e300, 1e-300});
  EXPECT_EQ(box,
            (Aabb{{largest, -infinity, 0}, {infinity, -largest, std::numeric_limits<float>::denorm_min()}}));
  EXPECT_TRUE(has_nan(round_outward({std::nan(""), 0, 0}, {1, 1, 1})));
}

/// Numbers of all sizes, and their neighbours; the results do not change with the mode.
std::vector<Aabb> rounded_numbers() {
  std::vector<Aabb> boxes;
  for (std::uint64_t exponent = 0; exponent <= 0x7ff; ++exponent) {
    for (const std::uint64_t digits :
         {0ULL, 1ULL, 0x1fffffffULL, 0x20000000ULL, 0x20000001ULL, 0xfffffe0000000ULL, 0xfffffffffffffULL}) {
      const auto value = std::bit_cast<double>(exponent << 52U | digits);
      boxes.push_back(round_outward({value, -value, 0}, {value, -value, -0.0}));
    }
  }
  return boxes;
}

/// As integers, so that NaNs and denormal numbers are compared, too.
bool same_boxes(const std::vector<Aabb>& s, const std::vector<Aabb>& t) {
  return std::ranges::equal(s, t, same_bits<Aabb>);
}

TEST(Aabb, DoublesRoundToTheNextFloats) {
  for (const Aabb& box : rounded_numbers()) {
    if (has_nan(box)) continue;
    EXPECT_EQ(box.lower[0], -box.upper[1]);
    EXPECT_EQ(box.upper[0], -box.lower[1]);
  }
  for (std::uint64_t exponent = 0; exponent < 0x7ff; ++exponent) {
    const auto value = std::bit_cast<double>(exponent << 52U | 0x123456789abcdULL);
    const Aabb box = round_outward({value, 0, 0}, {value, 0, 0});
    EXPECT_LT(static_cast<double>(box.lower[0]), value);
    EXPECT_GT(static_cast<double>(box.upper[0]), value);
    EXPECT_EQ(std::nextafter(box.lower[0], infinity), box.upper[0]);
  }
}

TEST(Aabb, DoublesRoundAlikeInEveryMode) {
  const std::vector<Aabb> expected = rounded_numbers();
  for (const int mode : test::rounding_modes) {
    const test::ScopedRounding rounding(mode);
    EXPECT_TRUE(same_boxes(rounded_numbers(), expected)) << mode;
  }
#ifdef __SSE2__
  const test::ScopedFlush flush;
  EXPECT_TRUE(same_boxes(rounded_numbers(), expected));
#endif
}

TEST(Aabb, EigenBoxesConvertBothWays) {
  const Eigen::AlignedBox3f box(Eigen::Vector3f(1, 2, 3), Eigen::Vector3f(4, 5, 6));
  EXPECT_EQ(to_aabb(box), (Aabb{{1, 2, 3}, {4, 5, 6}}));
  EXPECT_TRUE(to_eigen(to_aabb(box)).isApprox(box));
  EXPECT_TRUE(is_empty(to_aabb(Eigen::AlignedBox3f())));
  const Eigen::AlignedBox3d exact(Eigen::Vector3d::Constant(0.1), Eigen::Vector3d::Constant(0.1));
  EXPECT_TRUE(to_eigen(to_aabb(exact)).cast<double>().contains(exact));
}

}  // namespace
}  // namespace broadcl
