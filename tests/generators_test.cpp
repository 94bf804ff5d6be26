#include "scenes/generators.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <broadcl/broad_phase.hpp>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <ostream>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "runs.hpp"
#include "scenes/scenario.hpp"

namespace broadcl::scenes {

// NOLINTNEXTLINE(readability-identifier-naming): with it gtest prints parameters.
static void PrintTo(MovingBoxes::Sizes sizes, std::ostream* out) {
  *out << (sizes == MovingBoxes::Sizes::uniform ? "uniform" : "mixed");
}

namespace {

using Sizes = MovingBoxes::Sizes;

double overlaps_per_box(std::span<const Aabb> boxes) {
  const std::vector<Pair> pairs = overlapping_pairs(boxes, {}, {.algorithm = "oracle"});
  return 2.0 * static_cast<double>(pairs.size()) / static_cast<double>(boxes.size());
}

Eigen::Vector3f centre(const Aabb& box) {
  return (Eigen::Vector3f(box.lower.data()) + Eigen::Vector3f(box.upper.data())) / 2;
}

Eigen::Vector3f extent(const Aabb& box) {
  return Eigen::Vector3f(box.upper.data()) - Eigen::Vector3f(box.lower.data());
}

float uniform_edge(double count) {
  return static_cast<float>(1 - std::sqrt(1 - std::cbrt(4 / count)));
}

/// A scene by its name.
std::vector<Aabb> scene(const std::string& name) {
  for (BoxScene& scene : box_scenes(400)) {
    if (scene.name == name) return std::move(scene.boxes);
  }
  ADD_FAILURE() << "no scene is named " << name;
  return {};
}

/// How many boxes of a scene have a property.
template <class Predicate>
std::ptrdiff_t count(const std::string& name, Predicate&& predicate) {
  const std::vector<Aabb> boxes = scene(name);
  return std::count_if(boxes.begin(), boxes.end(), predicate);
}

/// How many bounds in a scene have a property.
template <class Predicate>
std::ptrdiff_t count_bounds(const std::string& name, Predicate&& predicate) {
  std::ptrdiff_t total = 0;
  for (const Aabb& box : scene(name)) {
    total += std::count_if(box.lower.begin(), box.lower.end(), predicate);
    total += std::count_if(box.upper.begin(), box.upper.end(), predicate);
  }
  return total;
}

TEST(MovingBoxes, OverlapAboutFourOthersIfSizesAreUniform) {
  MovingBoxes boxes(3500, Sizes::uniform);
  EXPECT_NEAR(overlaps_per_box(boxes.boxes()), 4, 0.3);
  for (int frame = 0; frame < 100; ++frame) boxes.advance();
  EXPECT_NEAR(overlaps_per_box(boxes.boxes()), 4, 0.3);
}

TEST(MovingBoxes, OverlapAboutTwentyOthersIfSizesAreMixed) {
  MovingBoxes boxes(3500, Sizes::mixed);
  EXPECT_NEAR(overlaps_per_box(boxes.boxes()), 20, 2);
  for (int frame = 0; frame < 100; ++frame) boxes.advance();
  EXPECT_NEAR(overlaps_per_box(boxes.boxes()), 20, 2);
}

TEST(MovingBoxes, HaveAThirdOfEachSizeIfMixed) {
  const MovingBoxes boxes(3500, Sizes::mixed);
  std::array<int, 3> count_by_class{};
  for (const Aabb& box : boxes.boxes()) {
    const float factor = extent(box).x() / uniform_edge(3500);
    const auto* size_class = std::find_if(mixed_sizes.begin(), mixed_sizes.end(), [&](const SizeClass& c) {
      return factor >= c.lower - 1e-3F && factor <= c.upper + 1e-3F;
    });
    ASSERT_NE(size_class, mixed_sizes.end()) << factor;
    ++count_by_class.at(static_cast<std::size_t>(size_class - mixed_sizes.begin()));
  }
  EXPECT_THAT(count_by_class, testing::Each(testing::AllOf(testing::Ge(1166), testing::Le(1167))));
}

class EachSizes : public testing::TestWithParam<Sizes> {};

NOT_IN(sanitizers, "takes long");
TEST_P(EachSizes, StayBetweenReflectingWalls) {
  constexpr std::size_t n = 500;
  const float step = uniform_edge(n) / 10;
  MovingBoxes boxes(n, GetParam());
  std::vector<Aabb> before(boxes.boxes().begin(), boxes.boxes().end());
  int reflections = 0;
  for (int frame = 0; frame < 300; ++frame) {
    boxes.advance();
    for (std::size_t k = 0; k < n; ++k) {
      const Eigen::Vector3f now = centre(boxes.boxes()[k]);
      ASSERT_GE(now.minCoeff(), -1e-5F);
      ASSERT_LE(now.maxCoeff(), 1 + 1e-5F);
      ASSERT_TRUE(extent(boxes.boxes()[k]).isApprox(extent(before[k]), 1e-3F));
      const float moved = (now - centre(before[k])).norm();
      if (moved < step - 1e-5F) ++reflections;
      ASSERT_LT(moved, step + 1e-5F);
    }
    before.assign(boxes.boxes().begin(), boxes.boxes().end());
  }
  EXPECT_GT(reflections, 500);
  EXPECT_LT(reflections, 300 * 500 / 10);
}

TEST_P(EachSizes, MoveInStraightLinesInAllDirections) {
  MovingBoxes boxes(3500, GetParam());
  const std::vector<Aabb> first(boxes.boxes().begin(), boxes.boxes().end());
  boxes.advance();
  const std::vector<Aabb> second(boxes.boxes().begin(), boxes.boxes().end());
  boxes.advance();
  Eigen::Vector3f mean = Eigen::Vector3f::Zero();
  int straight = 0;
  for (std::size_t k = 0; k < first.size(); ++k) {
    const Eigen::Vector3f step = centre(second[k]) - centre(first[k]);
    const Eigen::Vector3f next = centre(boxes.boxes()[k]) - centre(second[k]);
    mean += step.normalized() / 3500;
    if (step.isApprox(next, 1e-3F)) ++straight;
  }
  EXPECT_GT(straight, 3400);
  EXPECT_LT(mean.norm(), 0.05F);
}

TEST_P(EachSizes, FollowFromTheirSeed) {
  MovingBoxes s(100, GetParam(), 3);
  MovingBoxes t(100, GetParam(), 3);
  const MovingBoxes other(100, GetParam(), 4);
  EXPECT_FALSE(std::equal(s.boxes().begin(), s.boxes().end(), other.boxes().begin()));
  for (int frame = 0; frame < 10; ++frame) {
    EXPECT_TRUE(std::equal(s.boxes().begin(), s.boxes().end(), t.boxes().begin()));
    s.advance();
    t.advance();
  }
}

TEST_P(EachSizes, ExistInAnyNumber) {
  for (const std::uint32_t n : {0U, 1U, 2U, 5U}) {
    MovingBoxes boxes(n, GetParam());
    boxes.advance();
    EXPECT_EQ(boxes.boxes().size(), n);
    for (const Aabb& box : boxes.boxes()) EXPECT_FALSE(is_empty(box));
  }
}

INSTANTIATE_TEST_SUITE_P(MovingBoxes, EachSizes, testing::Values(Sizes::uniform, Sizes::mixed),
                         testing::PrintToStringParamName());

TEST(BoxScenes, HaveDistinctNamesTheSizeAskedForAndNoNan) {
  for (const std::uint32_t n : {0U, 1U, 2U, 33U, 400U}) {
    std::set<std::string> names;
    for (const BoxScene& scene : box_scenes(n)) {
      EXPECT_EQ(scene.boxes.size(), n) << scene.name;
      EXPECT_TRUE(names.insert(scene.name).second) << scene.name;
      EXPECT_TRUE(std::none_of(scene.boxes.begin(), scene.boxes.end(), has_nan)) << scene.name;
    }
  }
}

TEST(BoxScenes, FollowFromTheirSeed) {
  const std::vector<BoxScene> s = box_scenes(50, 1);
  const std::vector<BoxScene> t = box_scenes(50, 1);
  const std::vector<BoxScene> other = box_scenes(50, 2);
  ASSERT_EQ(s.size(), t.size());
  for (std::size_t k = 0; k < s.size(); ++k) EXPECT_EQ(s[k].boxes, t[k].boxes) << s[k].name;
  EXPECT_NE(s.front().boxes, other.front().boxes);
}

TEST(BoxScenes, HavePairsAndBoxesApart) {
  for (const BoxScene& scene : box_scenes(400)) {
    const double overlaps = overlaps_per_box(scene.boxes);
    EXPECT_GT(overlaps, 0) << scene.name;
    if (scene.name == "identical" || scene.name == "all-overlapping") {
      EXPECT_EQ(overlaps, 399) << scene.name;
    } else {
      EXPECT_LT(overlaps, 398) << scene.name;
    }
  }
}

TEST(BoxScenes, HoldPointsOfWhichSomeCoincide) {
  std::set<std::array<float, 3>> points;
  const auto is_point = [](const Aabb& box) { return box.lower == box.upper; };
  for (const Aabb& box : scene("points")) {
    if (is_point(box)) points.insert(box.lower);
  }
  EXPECT_GT(count("points", is_point), 100);
  EXPECT_LT(points.size(), 190U);
}

TEST(BoxScenes, HoldTouchingAndAlmostTouchingBoxes) {
  const std::vector<Aabb> touching = scene("touching");
  EXPECT_TRUE(overlaps(touching[0], touching[1]));
  EXPECT_EQ(touching[0].upper[0], touching[1].lower[0]);
  const std::vector<Aabb> apart = scene("almost-touching");
  EXPECT_FALSE(overlaps(apart[0], apart[1]));
  EXPECT_EQ(std::nextafter(apart[0].upper[0], 2.0F), apart[1].lower[0]);
}

TEST(BoxScenes, HoldWhatTheirNamesSay) {
  struct Case {
    std::string scene;
    std::function<bool(const Aabb&)> holds;
    std::ptrdiff_t boxes;
  };
  const Aabb identical = scene("identical").front();
  const std::vector<Aabb> around = scene("one-around-all");
  const std::vector<Case> cases{
      {"identical", [&](const Aabb& box) { return box == identical; }, 400},
      {"flat", [](const Aabb& box) { return box.lower[1] == 3 && box.upper[1] == 3; }, 400},
      {"line", [](const Aabb& box) { return box.lower[0] == box.upper[0] && box.lower[2] == box.upper[2]; },
       400},
      {"needles", [](const Aabb& box) { return extent(box).maxCoeff() == 100; }, 400},
      {"one-around-all",
       [&](const Aabb& box) {
         return std::ranges::all_of(around, [&](const Aabb& other) { return overlaps(box, other); });
       },
       1},
      {"clusters", [](const Aabb& box) { return box.lower[0] < 2; }, 100},
      {"clusters", [](const Aabb& box) { return box.lower[0] > 2999 && box.upper[0] < 3002; }, 100}};
  for (const Case& expected : cases)
    EXPECT_EQ(count(expected.scene, expected.holds), expected.boxes) << expected.scene;
}

TEST(BoxScenes, HoldEmptyBoxesInsideOthers) {
  EXPECT_GT(count("empty", is_empty), 150);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_GT(count("empty",
                    [&](const Aabb& box) {
                      return is_empty(box) && std::isfinite(box.lower[0]) &&
                             box.lower[axis] > box.upper[axis];
                    }),
              10);
  }
  EXPECT_GT(count("empty", [](const Aabb& box) { return std::isinf(box.lower[0]); }), 10);
}

TEST(BoxScenes, HoldInfiniteBounds) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  const auto any_axis = [](const Aabb& box, float lower, float upper) {
    bool any = false;
    for (std::size_t axis = 0; axis < 3; ++axis) any |= box.lower[axis] == lower && box.upper[axis] == upper;
    return any;
  };
  EXPECT_EQ(count("infinite", is_empty), 0);
  EXPECT_GT(count("infinite", [&](const Aabb& box) { return any_axis(box, -infinity, infinity); }), 10);
  EXPECT_GT(count("infinite", [&](const Aabb& box) { return any_axis(box, infinity, infinity); }), 10);
  EXPECT_GT(count("infinite", [&](const Aabb& box) { return any_axis(box, -infinity, -infinity); }), 10);
  EXPECT_EQ(count("infinite", [&](const Aabb& box) { return extent(box).minCoeff() == infinity; }), 1);
}

TEST(BoxScenes, HoldUnusualNumbers) {
  const auto is = [](float magnitude) { return [=](float bound) { return std::abs(bound) == magnitude; }; };
  const auto is_zero = [](bool negative) {
    return [=](float bound) { return bound == 0 && std::signbit(bound) == negative; };
  };
  for (const auto& [name, magnitude] : {std::pair("huge-1e18", 1e18F), std::pair("huge-1e30", 1e30F),
                                        std::pair("huge-flt-max", std::numeric_limits<float>::max())}) {
    EXPECT_GT(count_bounds(name, is(magnitude)), 100);
    EXPECT_EQ(count(name, is_empty), 0);
    EXPECT_EQ(count_bounds(name, [](float bound) { return std::isinf(bound); }), 0);
  }
  EXPECT_EQ(count_bounds("denormal", [](float bound) { return std::isnormal(bound); }), 0);
  EXPECT_GT(count_bounds("denormal", [](float bound) { return bound != 0; }), 2000);
  EXPECT_GT(count_bounds("negative-zero", is_zero(true)), 100);
  EXPECT_GT(count_bounds("negative-zero", is_zero(false)), 100);
  EXPECT_EQ(count_bounds("far-from-origin", [](float bound) { return bound >= 1e7F; }), 2400);
}

}  // namespace
}  // namespace broadcl::scenes
