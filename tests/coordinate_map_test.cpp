#include "base/coordinate_map.hpp"

#include <algorithm>
#include <cfenv>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "boxes64.hpp"
#include "rounding.hpp"

/// Images of bounds in float32: what overlaps still does, whatever the boxes.
namespace broadcl::test {
namespace {

constexpr double nan64 = std::numeric_limits<double>::quiet_NaN();
constexpr Aabb64 missing{{nan64, nan64, nan64}, {nan64, nan64, nan64}};

CoordinateMap map_of(const Boxes64& boxes, std::size_t threads = 1) {
  return {boxes.size(),
          [&](std::size_t first, std::span<Aabb64> out) {
            std::copy_n(boxes.begin() + static_cast<std::ptrdiff_t>(first), out.size(), out.begin());
          },
          false, threads};
}

std::pair<std::vector<Aabb>, unsigned> converted(const CoordinateMap& map, const Boxes64& boxes) {
  std::vector<Aabb> images(boxes.size());
  const unsigned found = map.convert(boxes, images);
  return {std::move(images), found};
}

Aabb64 point(double bound) {
  return {{bound, bound, bound}, {bound, bound, bound}};
}

unsigned found_of(const CoordinateMap& map, double bound, std::size_t axis) {
  Aabb64 box{};
  box.lower[axis] = box.upper[axis] = bound;
  return converted(map, {box}).second & (1U << axis | CoordinateMap::away | CoordinateMap::outside);
}

/// So many clusters of boxes.
Boxes64 clusters(std::uint32_t seed, int clusters, int boxes, double distance, double side, double length) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> place(0, side), size(length / 2, length),
      centre(-distance, distance);
  Boxes64 result;
  for (int cluster = 0; cluster < clusters; ++cluster) {
    const std::array<double, 3> corner{centre(random), centre(random), centre(random)};
    for (int k = 0; k < boxes; ++k) {
      Aabb64& box = result.emplace_back();
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box.lower[axis] = corner[axis] + place(random);
        box.upper[axis] = box.lower[axis] + size(random);
      }
    }
  }
  return result;
}

Boxes64 moved(Boxes64 boxes, double distance) {
  for (Aabb64& box : boxes) {
    for (double* const bound :
         {&box.lower[0], &box.lower[1], &box.lower[2], &box.upper[0], &box.upper[1], &box.upper[2]}) {
      *bound += distance;
    }
  }
  return boxes;
}

Boxes64 with(Boxes64 boxes, const Boxes64& others) {
  boxes.insert(boxes.end(), others.begin(), others.end());
  return boxes;
}

/// On the edge of what float64 can tell: small boxes near 0, and points one to three ulps apart.
Boxes64 ulps(double place) {
  Boxes64 boxes = clusters(1, 1, 60, 0, 1, 1e-3);
  std::mt19937 random(2);
  for (int k = 0; k < 40; ++k) {
    boxes.push_back(point(place));
    for (auto steps = random() % 3 + 1; steps > 0; --steps) place = std::nextafter(place, infinity64);
  }
  return boxes;
}

Boxes64 special_boxes_or_missing() {
  Boxes64 boxes = special_boxes();
  std::ranges::replace_if(
      boxes, [](const Aabb64& box) { return is_empty(box); }, missing);
  return boxes;
}

struct Scene {
  std::string name;
  Boxes64 boxes;
};

std::vector<Scene> scenes() {
  constexpr double largest = std::numeric_limits<double>::max();
  const Boxes64 towns = clusters(1, 30, 10, 6.4e6, 0.01, 1e-3);
  Boxes64 flat = towns;
  for (Aabb64& box : flat) box.lower[2] = box.upper[2] = 0;
  Boxes64 points = towns;
  for (Aabb64& box : points) box.upper = box.lower;
  const Aabb64 plane{{-6.4e6, -6.4e6, -1}, {6.4e6, 6.4e6, 0}};
  return {{"none", {}},
          {"one cluster", clusters(1, 1, 200, 0, 10, 1)},
          {"one cluster far away", clusters(1, 1, 200, 1e9, 10, 1)},
          {"two clusters", clusters(2, 2, 100, 1e7, 10, 1)},
          {"clusters of different kinds",
           with(clusters(1, 3, 80, 1e15, 1e6, 1), clusters(2, 20, 5, 1, 1e-3, 1e-6))},
          {"clusters in clusters", with(clusters(3, 9, 20, 1e3, 1e-4, 1e-5), {point(1e12), point(-3e14)})},
          {"clusters nearly side by side", clusters(4, 200, 2, 3e3, 1e-3, 1e-3)},
          {"towns", towns},
          {"a plane across towns", with(towns, {plane})},
          {"infinite boxes and empty ones in towns",
           with(towns,
                {missing, point(infinity64), {{-infinity64, -infinity64, 0}, {infinity64, 1, infinity64}}})},
          {"towns in a plane", flat},
          {"points", points},
          {"all equal", Boxes64(10, point(6.4e6))},
          {"empty boxes only", Boxes64(3, missing)},
          {"infinite boxes only", {point(infinity64), point(-infinity64)}},
          {"ulps", ulps(1e15)},
          {"ulps below zero", ulps(-0x1p47)},
          {"near the largest numbers",
           with(clusters(5, 20, 10, 1e308, 1e300, 1e299), {point(largest), point(-largest)})},
          {"as long as the largest numbers", {{{4e299, 0, -largest}, {1e307, 3e299, 4e299}}}},
          {"beyond float32", clusters(6, 20, 10, 1e200, 1e150, 1e149)},
          {"small boxes beyond float32", with(towns, {point(1e300), point(-1e40), point(largest)})},
          {"small numbers", clusters(7, 20, 10, 1e-100, 1e-110, 1e-111)},
          {"denormal numbers", clusters(8, 20, 10, 1e-310, 1e-315, 1e-316)},
          {"special boxes", special_boxes_or_missing()}};
}

/// Bounds of the boxes on an axis, what is beside them, at the ends of intervals, between and beyond.
std::vector<double> numbers_of(const Boxes64& boxes, const CoordinateMap& map, std::size_t axis) {
  std::vector<double> bounds{0};
  for (const Aabb64& box : boxes) {
    if (!std::isnan(box.lower[axis])) bounds.insert(bounds.end(), {box.lower[axis], box.upper[axis]});
  }
  std::ranges::sort(bounds);
  std::vector<double> numbers = bounds;
  numbers.insert(numbers.end(),
                 {-0.0, 1e-310, -1e-310, 1e-42, 1, infinity64, -infinity64, 1.7e308, -1.7e308});
  std::mt19937 random(1);
  for (std::size_t k = 1; k < bounds.size(); ++k) {
    const double length = bounds[k] / 2 - bounds[k - 1] / 2;
    if (!(length > 0 && length < infinity64)) continue;
    double inside = bounds[k - 1];
    double outside = inside + length;
    for (int part = 0; part < 3; ++part) {
      numbers.push_back(inside + length * std::uniform_real_distribution<double>(0, 2)(random));
    }
    // By bisection, where the interval ends.
    while (std::nextafter(inside, infinity64) < outside && k % 7 == 0) {
      const double middle = inside + (outside - inside) / 2;
      ((found_of(map, middle, axis) & CoordinateMap::away) != 0 ? outside : inside) = middle;
    }
    numbers.insert(numbers.end(), {inside, outside, length});
  }
  for (std::size_t k = 0, n = numbers.size(); k < n; ++k) {
    for (const double direction : {-infinity64, infinity64})
      numbers.push_back(std::nextafter(numbers[k], direction));
  }
  std::ranges::sort(numbers);
  return numbers;
}

/// Whether a number is between those that may have its image.
bool is_original(const CoordinateMap& map, std::size_t axis, float image, double number) {
  const CoordinateMap::Shift back = map.shift_along(axis);
  const double moved = static_cast<double>(image) + back.shift;
  const double off = std::abs(static_cast<double>(image)) * CoordinateMap::relative_error + back.error;
  if (back.limit > 0 && std::abs(static_cast<double>(image)) <= back.limit && std::isfinite(image))
    return moved - off <= number && number <= moved + off;
  return (back.limit > 0 && std::isinf(back.limit)) ||
         (map.least_original(axis, image) <= number && number <= map.greatest_original(axis, image));
}

/// What makes pairs and queries exact.
void expect_order(const CoordinateMap& map, const std::vector<double>& numbers, std::size_t axis) {
  float last = -std::numeric_limits<float>::infinity();
  double told_apart = nan64;  // with the last image
  double before = nan64;
  for (const double number : numbers) {
    const auto [images, found] = converted(map, {point(number)});
    const float image = images[0].lower[axis];
    ASSERT_EQ(image, images[0].upper[axis]);
    ASSERT_TRUE(is_original(map, axis, image, number)) << number << " on axis " << axis;
    ASSERT_GE(image, last) << number << " on axis " << axis;
    ASSERT_TRUE(image == 0 ? !std::signbit(image) : std::fpclassify(image) != FP_SUBNORMAL) << number;
    ASSERT_TRUE(number != before || image == last) << number;
    if (image > last) told_apart = nan64;
    if ((found & (1U << axis)) == 0) {
      ASSERT_FALSE(told_apart < number)
          << "the images of " << told_apart << " and " << number << " are equal";
      told_apart = number;
    }
    last = image;
    before = number;
  }
}

void expect_exact(const CoordinateMap& map, const Boxes64& boxes) {
  for (std::size_t axis = 0; axis < 3; ++axis) expect_order(map, numbers_of(boxes, map, axis), axis);
  const auto [images, found] = converted(map, boxes);
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    EXPECT_EQ(has_nan(images[b]), has_nan(boxes[b]));
    for (std::size_t a = 0; a < b; ++a) {
      ASSERT_TRUE(!overlaps(boxes[a], boxes[b]) || overlaps(images[a], images[b])) << a << ", " << b;
    }
  }
}

TEST(CoordinateMap, IsInOrder) {
  for (const auto& [name, boxes] : scenes()) {
    SCOPED_TRACE(name);
    const CoordinateMap map = map_of(boxes);
    expect_exact(map, boxes);
    EXPECT_LT(converted(map, boxes).second, unsigned{CoordinateMap::away});
    EXPECT_EQ(converted(map_of(boxes, 3), boxes).second, converted(map, boxes).second);
  }
  CoordinateMap map;
  map.follow(special_boxes_or_missing());
  expect_exact(map, special_boxes_or_missing());
}

TEST(CoordinateMap, DoesNotDependOnTheRoundingOfTheCaller) {
  for (const auto& [name, boxes] : scenes()) {
    SCOPED_TRACE(name);
    Boxes64 proper = boxes;
    std::erase_if(proper, [](const Aabb64& box) { return has_nan(box); });
    const auto expected = converted(map_of(proper), proper);
    for (const int mode : rounding_modes) {
      const ScopedRounding rounding(mode);
      EXPECT_EQ(converted(map_of(proper), proper), expected);
      EXPECT_EQ(std::fegetround(), mode);
    }
#ifdef __SSE2__
    const ScopedFlush flush;
    EXPECT_EQ(converted(map_of(proper), proper), expected);
#endif
  }
}

/// Of the pairs that overlap in float32, nearly all do.
/// Also if there are fewer parts of boxes than threads.
TEST(CoordinateMap, IsTheSameWithThreads) {
  for (const Boxes64& boxes : {clusters(1, 1, 20'000, 0, 1, 0.01), clusters(2, 100, 200, 1e7, 1, 0.01)}) {
    EXPECT_EQ(converted(map_of(boxes, 1), boxes), converted(map_of(boxes, 7), boxes));
  }
}

TEST(CoordinateMap, ResolvesClustersFarApart) {
  const Boxes64 towns = clusters(1, 100, 20, 6.4e6, 0.003, 1e-3);
  const std::vector<Scene> resolved{
      {"one cluster", clusters(2, 1, 1000, 1e7, 10, 1)},
      {"eight clusters", clusters(1, 8, 200, 1e7, 7, 1)},
      {"towns", towns},
      {"a plane across towns", with(towns, {{{-6.4e6, -6.4e6, -1}, {6.4e6, 6.4e6, 0}}})},
      {"a box far away", with(clusters(1, 1, 500, 1e3, 10, 1), {point(1e18), point(-1e30)})},
      {"a short box", with(clusters(2, 2, 200, 1e7, 7, 1), {{{0.3, 0.3, 0.3}, {0.1 * 3, 0.1 * 3, 0.1 * 3}}})},
      {"clusters in clusters",
       with(clusters(1, 50, 20, 1e3, 0.003, 1e-3), clusters(2, 2, 20, 1e13, 0.003, 1e-3))}};
  for (const auto& [name, boxes] : resolved) {
    const std::vector<Aabb> images = converted(map_of(boxes), boxes).first;
    std::size_t together = 0;
    std::size_t apart = 0;
    for (std::size_t b = 0; b < boxes.size(); ++b) {
      for (std::size_t a = 0; a < b; ++a) {
        if (overlaps(images[a], images[b])) ++(overlaps(boxes[a], boxes[b]) ? together : apart);
      }
    }
    EXPECT_GT(together, 300U) << name;
    EXPECT_LT(100 * apart, together) << name;
  }
}

TEST(CoordinateMap, IntegersFarApartAreNotInDoubt) {
  Boxes64 boxes;
  for (const double place : {-1e9, 0.0, 7e8}) {
    for (int k = 0; k < 50; ++k)
      boxes.push_back({{place + k, k - place, 0}, {place + k + 1, k - place + 2, 0}});
  }
  EXPECT_EQ(converted(map_of(boxes), boxes).second, 0U);
  boxes[7].lower[1] -= 1e-7;
  EXPECT_EQ(converted(map_of(boxes), boxes).second, 2U);
}

TEST(CoordinateMap, FollowsAConvoy) {
  const Boxes64 boxes = with(clusters(1, 30, 20, 6.4e6, 1, 1e-2), {point(infinity64)});
  CoordinateMap map = map_of(boxes);
  const auto expected = converted(map, boxes);
  const auto bits = [&](const Boxes64& of) { return converted(map, of).second / CoordinateMap::away; };
  EXPECT_EQ(bits(boxes), 0U);
  for (const double at : {1e5, 1e5 + 0.2, 1e5 + 3, -3e6, 2e7, 5e9}) {
    const Boxes64 convoy = moved(clusters(3, 1, 40, 0, 0.2, 1e-2), at);
    map.follow(convoy);
    EXPECT_EQ(bits(convoy), 1U) << at;
    EXPECT_EQ(converted(map, boxes), expected);
    expect_exact(map, with(boxes, convoy));
    const auto images = converted(map, convoy);
    map.follow(moved(convoy, 0.2));
    EXPECT_EQ(converted(map, convoy), images) << "windows move without need";
  }
  // Too far apart for one window: that in the middle is resolved.
  map.follow(std::vector{point(1e5), point(2e5), point(3e5)});
  EXPECT_EQ(bits({point(2e5)}), 1U);
  EXPECT_EQ(bits({point(3e5)}), 3U);
}

TEST(CoordinateMap, AwayFromOnePlace) {
  const CoordinateMap map = map_of(clusters(1, 1, 100, 0, 100, 1));
  EXPECT_EQ(found_of(map, 5e3, 0), 0U);
  EXPECT_EQ(found_of(map, infinity64, 0), 0U);
  EXPECT_EQ(found_of(map, -4e4, 2), unsigned{CoordinateMap::away});
  EXPECT_EQ(found_of(map, 0x1p200, 2), 4U | CoordinateMap::away | CoordinateMap::outside);
}

TEST(CoordinateMap, Halves) {
  const CoordinateMap small = map_of(clusters(1, 1, 100, 0, 10, 1));
  const CoordinateMap large = map_of(clusters(1, 1, 100, 0, 40, 1));
  EXPECT_TRUE(small.halves(large));
  EXPECT_FALSE(large.halves(small));
  EXPECT_FALSE(small.halves(small));
  EXPECT_TRUE(map_of(clusters(1, 2, 100, 1e7, 10, 1)).halves(map_of({point(-1e7), point(1e7)})));
}

}  // namespace
}  // namespace broadcl::test
