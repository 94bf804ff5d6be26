#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include <broadcl/eigen.hpp>

namespace broadcl {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();
constexpr Aabb unit{{0, 0, 0}, {1, 1, 1}};

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
  EXPECT_TRUE(is_empty(empty_aabb()));
  EXPECT_FALSE(overlaps(empty_aabb(), {{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}}));
}

TEST(Aabb, NaNIsFoundInEveryPlace) {
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
