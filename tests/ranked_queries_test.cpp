#include <algorithm>
#include <array>
#include <cfenv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <random>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "boxes.hpp"
#include "expect_error.hpp"
#include "expected_ranked_hits.hpp"
#include "rounding.hpp"

/// Nearest objects, rays, and boxes that move. (queries_test.cpp compares them with the definition, whatever
/// changes.)
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;
using Vector = std::array<float, 3>;

const BroadPhase::Config on_host{.algorithm = "sweep-and-prune"};

Aabb point(float x, float y, float z) {
  return {{x, y, z}, {x, y, z}};
}

template <class Box = Aabb>
BasicBroadPhase<Box> with(const std::vector<Box>& boxes) {
  BasicBroadPhase<Box> broad_phase(on_host);
  (void)broad_phase.add(boxes);
  (void)broad_phase.update();
  return broad_phase;
}

std::vector<std::uint32_t> first_ids(std::size_t n) {
  std::vector<std::uint32_t> ids(n);
  std::iota(ids.begin(), ids.end(), 0U);
  return ids;
}

/// What a ray meets.
Hits ray(const BroadPhase& broad_phase, const Aabb& start, const Vector& direction, float length = infinity,
         const QueryOptions& options = {}) {
  return broad_phase.along(BoxView(std::span(&start, 1)), {{direction}}, {{length}}, options);
}
std::vector<std::uint32_t> met(const BroadPhase& broad_phase, const Aabb& start, const Vector& direction,
                               float length = infinity) {
  return ray(broad_phase, start, direction, length).ids;
}

TEST(Nearest, AtTheSameDistanceAreThoseOfTheLowestIds) {
  for (const std::size_t n : {5U, 40U, 1500U, 40'000U}) {
    SCOPED_TRACE(n);
    BroadPhase broad_phase(on_host);
    const std::vector<Aabb> boxes(n, unit);
    (void)broad_phase.add(boxes);  // no update, since there would be too many pairs
    const std::vector<Aabb> queries{point(0.5F, 0.5F, 0.5F), point(3, 0.5F, 0.5F)};
    for (const std::uint32_t limit : {1U, 3U, 33U}) {
      const Hits hits = broad_phase.nearest(queries, {.limit = limit});
      const std::vector<std::uint32_t> expected = first_ids(std::min<std::size_t>(n, limit));
      EXPECT_TRUE(std::ranges::equal(hits[0], expected));
      EXPECT_TRUE(std::ranges::equal(hits[1], expected));
      EXPECT_EQ(hits.squared_distances.front(), 0);
      EXPECT_EQ(hits.squared_distances.back(), 4);
    }
    // In any order, and with others that come later.
    std::vector<std::uint32_t> moved;
    for (std::uint32_t id = 0; id < n; id += 3) moved.push_back(id);
    const std::vector<Aabb> away(moved.size(), point(9, 9, 9));
    const std::vector<Aabb> back(moved.size(), unit);
    broad_phase.move(moved, away);
    EXPECT_EQ(broad_phase.nearest(queries, {.limit = 1}).ids.front(), 1U);
    broad_phase.move(moved, back);
    const std::vector<std::uint32_t> three = first_ids(3);
    EXPECT_EQ(broad_phase.nearest(std::span(queries).first(1), {.limit = 3}).ids, three);
    EXPECT_EQ(ray(broad_phase, point(-1, 0.5F, 0.5F), {1, 0, 0}, infinity, {.limit = 3}).ids, three);
  }
}

TEST(Nearest, InOrderOfDistance) {
  std::vector<Aabb> boxes(1000);
  for (std::size_t k = 0; k < boxes.size(); ++k) boxes[k] = point(static_cast<float>(k * 389 % 1000), 0, 0);
  const BroadPhase broad_phase = with(boxes);
  const std::vector<Aabb> queries{point(499.5F, 0, 0), point(-10, 0, 0)};
  const Hits hits = broad_phase.nearest(queries, {.limit = 4});
  for (std::size_t k = 0; k < 4; ++k) {
    const double distance = k < 2 ? 0.5 : 1.5;
    EXPECT_EQ(hits.squared_distances[k], distance * distance);
    EXPECT_EQ(boxes[hits[1][k]].lower[0], static_cast<float>(k));
  }
  EXPECT_LT(hits[0][0], hits[0][1]);  // at the same distance
  EXPECT_LT(hits[0][2], hits[0][3]);
  // Without a limit, all within a radius, in order.
  const Hits near = broad_phase.nearest(queries, {.within = 12});
  EXPECT_EQ(near[0].size(), 24U);
  EXPECT_EQ(near[1].size(), 3U);
  EXPECT_TRUE(std::is_sorted(near.squared_distances.begin(), near.squared_distances.begin() + 24));
  EXPECT_EQ(broad_phase.nearest(queries).ids.size(), 2000U);
  EXPECT_TRUE(broad_phase.nearest(queries, {.limit = 0}).ids.empty());
  EXPECT_EQ(broad_phase.nearest(queries, {.limit = 7, .count_only = true}).offsets.back(), 14U);
}

TEST(Nearest, EmptyAndInfiniteBoxes) {
  const std::vector<Aabb> boxes{empty_aabb(),
                                point(infinity, 0, 0),
                                {{-infinity, 5, -infinity}, {infinity, 6, infinity}},
                                point(1, 0, 0),
                                {{0, 0, 0}, {-1, 0, 0}},
                                {{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}}};
  const BroadPhase broad_phase = with(boxes);
  const std::vector<Aabb> queries{point(0, 0, 0), empty_aabb(), boxes[5], point(infinity, 0, 0)};
  const Hits hits = broad_phase.nearest(queries);
  using Ids = std::vector<std::uint32_t>;
  EXPECT_TRUE(std::ranges::equal(hits[0], Ids{5, 3, 2, 1}));
  EXPECT_EQ(hits.squared_distances[3], infinity);
  EXPECT_TRUE(hits[1].empty());
  EXPECT_TRUE(std::ranges::equal(hits[2], Ids{1, 2, 3, 5}));
  EXPECT_TRUE(std::ranges::equal(hits[3], Ids{1, 5, 2, 3}));
  EXPECT_TRUE(broad_phase.nearest({}, {}).ids.empty());
}

TEST(Nearest, GapsThatCountAsNothingAreNoOverlap) {
  const BroadPhase broad_phase = with<Aabb>({unit, point(1, 1, 1)});
  const std::vector<Aabb> beside{point(std::ldexp(-1.0F, -64), 0, 0)};
  EXPECT_EQ(broad_phase.nearest(beside, {.limit = 1}).squared_distances, std::vector<double>{0});
  EXPECT_TRUE(broad_phase.nearest(beside, {.within = 0}).ids.empty());
  EXPECT_EQ(broad_phase.nearest(beside, {.within = 1e-10}).ids.size(), 1U);
}

TEST(Along, FacesEdgesAndDiagonals) {
  const BroadPhase broad_phase = with<Aabb>({unit});
  const std::vector<std::uint32_t> one{0};
  for (const float y : {0.0F, 0.5F, 1.0F}) {
    for (const float z : {0.0F, 0.5F, 1.0F}) {
      EXPECT_EQ(met(broad_phase, point(-1, y, z), {1, 0, 0}), one);
      EXPECT_EQ(met(broad_phase, point(2, y, z), {-1, 0, -0.0F}), one);
      EXPECT_EQ(met(broad_phase, point(z, y, -7), {0, 0, 1}), one);
    }
  }
  EXPECT_TRUE(met(broad_phase, point(-1, std::nextafter(1.0F, 2.0F), 0), {1, 0, 0}).empty());
  EXPECT_TRUE(met(broad_phase, point(-1, 0.5F, 0.5F), {-1, 0, 0}).empty());
  EXPECT_EQ(met(broad_phase, point(-1, -1, -1), {1, 1, 1}), one);
  EXPECT_EQ(met(broad_phase, point(-1, 0, 0), {1, 1, 0}), one);  // through the edge
  EXPECT_TRUE(met(broad_phase, point(-1, 1, 0), {1, 1, 0}).empty());
  EXPECT_TRUE(met(broad_phase, point(-1, std::ldexp(1.0F, -23), 0), {1, 1, 0}).empty());
  const Hits hits = ray(broad_phase, point(-3, 0.5F, 0.5F), {2, 0, 0});
  EXPECT_EQ(hits.times, std::vector<double>{1.5});
}

TEST(Along, LengthsAndStarts) {
  const BroadPhase broad_phase = with<Aabb>({unit, {{5, 0, 0}, {6, 1, 1}}});
  using Ids = std::vector<std::uint32_t>;
  EXPECT_EQ(met(broad_phase, point(-1, 0, 0), {1, 0, 0}, 1), Ids{0});
  EXPECT_EQ(met(broad_phase, point(-1, 0, 0), {1, 0, 0}, std::nextafter(1.0F, 0.0F)), Ids{});
  EXPECT_EQ(met(broad_phase, point(-1, 0, 0), {1, 0, 0}, 6), (Ids{0, 1}));
  EXPECT_EQ(met(broad_phase, point(7, 0, 0), {-1, 0, 0}), (Ids{1, 0}));
  // From inside, from a face, and away from it.
  EXPECT_EQ(ray(broad_phase, point(0.5F, 0.5F, 0.5F), {1, 0, 0}, 0).times, std::vector<double>{0});
  EXPECT_EQ(met(broad_phase, point(1, 0.5F, 0.5F), {1, 0, 0}), (Ids{0, 1}));
  EXPECT_EQ(met(broad_phase, point(1, 0.5F, 0.5F), {0, 1, 0}, 0), Ids{0});
  // No direction: what the start overlaps. What is nearly none is none.
  EXPECT_EQ(met(broad_phase, {{0, 0, 0}, {5, 1, 1}}, {0, 0, 0}), (Ids{0, 1}));
  constexpr float least = std::numeric_limits<float>::denorm_min();
  EXPECT_EQ(met(broad_phase, point(2, 0, 0), {least, 0, 0}), Ids{});
  EXPECT_EQ(met(broad_phase, point(0, 0, 0), {least, -least, least}), Ids{0});
  constexpr float most = std::numeric_limits<float>::max();
  EXPECT_EQ(met(broad_phase, point(-1, 0, 0), {most, 0, 0}), (Ids{0, 1}));
  // A box meets what it touches.
  EXPECT_EQ(met(broad_phase, {{-2, 1, 1}, {-1, 9, 9}}, {1, 0, 0}), (Ids{0, 1}));
  EXPECT_EQ(met(broad_phase, {{-2, 1.01F, 1}, {-1, 9, 9}}, {1, 0, 0}), Ids{});
  EXPECT_EQ(ray(broad_phase, {{-4, 0, 0}, {-2, 9, 9}}, {1, 0, 0}).times, (std::vector<double>{2, 7}));
  EXPECT_EQ(met(broad_phase, empty_aabb(), {1, 0, 0}), Ids{});
}

TEST(Along, InfiniteBoxes) {
  const BroadPhase broad_phase =
      with<Aabb>({{{-infinity, -infinity, 3}, {infinity, infinity, 4}},
                  {{7, -infinity, -infinity}, {infinity, infinity, infinity}},
                  {{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}},
                  empty_aabb()});
  const Hits up = ray(broad_phase, point(0, 0, 0), {0, 0, 1});
  EXPECT_EQ(up.ids, (std::vector<std::uint32_t>{2, 0}));
  EXPECT_EQ(up.times, (std::vector<double>{0, 3}));
  EXPECT_EQ(met(broad_phase, point(0, 0, 0), {1, 0, -1}), (std::vector<std::uint32_t>{2, 1}));
}

/// Each way finds the same: one by one and many, closest and all, and in the order of other bits of the time.
TEST(Along, TheClosestAreTheFirstOfAll) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> place(-10, 10), size(0, 1), step(-1, 1);
  std::vector<Aabb> boxes(8000);
  for (Aabb& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = place(random);
      box.upper[axis] = box.lower[axis] + size(random) * size(random);
    }
  }
  const BroadPhase broad_phase = with(boxes);
  std::vector<Aabb> starts(300);
  std::vector<Vector> directions(starts.size());
  for (std::size_t k = 0; k < starts.size(); ++k) {
    starts[k] = point(place(random), place(random), place(random));
    directions[k] = {step(random), step(random), step(random)};
  }
  const std::vector<float> lengths{12};
  const Hits all = broad_phase.along(starts, directions, lengths);
  EXPECT_GT(all.ids.size(), 100U);
  for (const std::uint32_t limit : {1U, 5U}) {
    const Hits first = broad_phase.along(starts, directions, lengths, {.limit = limit});
    for (std::size_t k = 0; k < starts.size(); ++k) {
      EXPECT_TRUE(std::ranges::equal(first[k], all[k].first(std::min<std::size_t>(limit, all[k].size()))))
          << k;
      if (limit > 1) continue;
      EXPECT_TRUE(std::ranges::equal(met(broad_phase, starts[k], directions[k], 12), all[k])) << k;
    }
  }
  Objects<Aabb> objects;
  objects.replace(boxes);
  const Ways<Aabb> ways{directions, std::vector<float>(starts.size(), 12)};
  expect_same_hits(all, expected_ranked_hits<Aabb>(objects, starts, &ways, {}));
}

/// A map that cuts gaps out keeps neither distances nor straight lines.
TEST(Ranked, InDoublePrecisionOverGaps) {
  for (const double offset : {0.0, 1e9}) {
    for (const bool has_reaches : {false, true}) {
      std::mt19937 random(4);
      std::uniform_real_distribution<double> part(0, 1);
      std::vector<Aabb64> boxes(4000);
      for (std::size_t k = 0; k < boxes.size(); ++k) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const double town = 1e7 * static_cast<double>(k * (axis + 3) % 7);
          boxes[k].lower[axis] = offset + town + part(random) * 10;
          boxes[k].upper[axis] = boxes[k].lower[axis] + part(random) * (k % 3 == 0 ? 0 : 1e-3);
        }
      }
      BroadPhase64 broad_phase(on_host);
      (void)broad_phase.add(boxes, {{Filter()}}, std::array<double, 1>{has_reaches ? 0.25 : 0});
      (void)broad_phase.update();
      Objects<Aabb64> objects;
      objects.replace(boxes);
      std::vector<Aabb64> queries;
      Ways<Aabb64> ways;
      for (std::size_t k = 0; k < 200; ++k) {
        Aabb64 query = boxes[k * 7];
        const Aabb64& other = boxes[k * 11 + 3];
        if (k % 4 == 0) query.lower[k % 3] = query.upper[k % 3] += 3e6 * part(random);  // in a gap
        queries.push_back(query);
        auto& direction = ways.directions.emplace_back();
        for (std::size_t axis = 0; axis < 3; ++axis)
          direction.at(axis) = std::midpoint(other.lower[axis], other.upper[axis]) - query.lower[axis];
        ways.lengths.push_back(k % 2 == 0 ? 1 : std::numeric_limits<double>::infinity());
      }
      for (const std::uint32_t limit : {1U, 8U, QueryOptions::all}) {
        const QueryOptions options{.limit = limit};
        expect_same_hits(broad_phase.nearest(queries, options),
                         expected_ranked_hits<Aabb64>(objects, queries, nullptr, options));
        expect_same_hits(broad_phase.along(queries, ways.directions, ways.lengths, options),
                         expected_ranked_hits<Aabb64>(objects, queries, &ways, options));
      }
      const Hits all = broad_phase.along(queries, ways.directions, ways.lengths);
      std::ptrdiff_t aimed = 0;
      for (std::size_t k = 0; k < queries.size(); ++k)
        aimed += std::ranges::count(all[k], static_cast<std::uint32_t>(k * 11 + 3));
      EXPECT_GT(aimed, 100);
    }
  }
}

TEST(Ranked, OfBoxesThatAreUsedOnce) {
  const std::vector<Aabb> boxes{unit, {{2, 0, 0}, {3, 1, 1}}};
  const std::vector<Aabb> starts{point(-1, 0.5F, 0.5F)};
  const std::vector<Aabb64> starts64{{{-1, 0.5, 0.5}, {-1, 0.5, 0.5}}};
  EXPECT_EQ(nearest(BoxView(boxes), BoxView(starts), {.limit = 1}).ids, std::vector<std::uint32_t>{0});
  EXPECT_EQ(nearest(BoxView(boxes), BoxView(starts64)).squared_distances, (std::vector<double>{1, 9}));
  const Hits hits = along(BoxView(boxes), BoxView(starts), {{{0.5, 0, 0}}});
  EXPECT_EQ(hits.ids, (std::vector<std::uint32_t>{0, 1}));
  EXPECT_EQ(hits.times, (std::vector<double>{2, 6}));
  EXPECT_EQ(along(BoxView(boxes), BoxView(starts64), {{{0.1, 0, 0}}}, {{10.0}}).times,
            std::vector<double>{10});
}

TEST(Ranked, RefuseWhatTheyCannotUse) {
  const BroadPhase broad_phase = with<Aabb>({unit});
  const std::vector<Aabb> three{unit, unit, unit};
  const auto error = [&](const std::vector<Aabb>& starts, const std::vector<Vector>& directions,
                         const std::vector<float>& lengths, const QueryOptions& options = {}) {
    return error_of([&] { (void)broad_phase.along(starts, directions, lengths, options); });
  };
  const Vector x{1, 0, 0};
  EXPECT_THAT(error(three, {x, x}, {}), HasSubstr("2 directions for 3 queries"));
  EXPECT_THAT(error(three, {}, {}), HasSubstr("0 directions for 3 queries"));
  EXPECT_THAT(error(three, {x}, {1, 2}), HasSubstr("2 lengths for 3 queries"));
  EXPECT_THAT(error(three, {x, {0, infinity, 0}, x}, {}), HasSubstr("direction 1 is infinite or NaN"));
  EXPECT_THAT(error(three, {{0, nan_value, 0}}, {}), HasSubstr("direction 0 is"));
  EXPECT_THAT(error(three, {x}, {-1}), HasSubstr("length 0 is -1"));
  EXPECT_THAT(error(three, {x}, {1, 1, nan_value}), HasSubstr("length 2 is"));
  EXPECT_THAT(error({unit, point(0, infinity, 0)}, {x}, {}), HasSubstr("start 1 is infinite"));
  EXPECT_THAT(error({unit, point(0, nan_value, 0)}, {x}, {}), HasSubstr("box 1 has a NaN"));
  EXPECT_THAT(error(three, {x}, {}, {.within = 1}), HasSubstr("within is given"));
  EXPECT_THAT(error(three, {x}, {}, {.most_hits = 2}), HasSubstr("more than 2"));
  EXPECT_THAT(error_of([&] { (void)broad_phase.nearest(three, {.most_hits = 2}); }),
              HasSubstr("more than 2"));
  EXPECT_THAT(error_of([&] { (void)broad_phase.nearest(three, {.within = -1}); }),
              HasSubstr("from 0 to 2^62"));
  const std::vector<Aabb> invalid{point(nan_value, 0, 0)};
  EXPECT_THAT(error_of([&] { (void)nearest(BoxView(three), BoxView(invalid)); }),
              HasSubstr("the queries: box 0 has a NaN"));
}

TEST(Ranked, DoNotDependOnTheRoundingMode) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> place(-10, 10);
  std::vector<Aabb> boxes(500);
  for (Aabb& box : boxes) box = point(place(random), place(random), 0);
  const BroadPhase broad_phase = with(boxes);
  const Hits near = broad_phase.nearest(boxes, {.limit = 5});
  const Hits along = broad_phase.along(boxes, {{{0.3F, 0.7F, 0}}}, {});
  const ScopedRounding rounding(FE_UPWARD);
  expect_same_hits(broad_phase.nearest(boxes, {.limit = 5}), near);
  expect_same_hits(broad_phase.along(boxes, {{{0.3F, 0.7F, 0}}}, {}), along);
}

}  // namespace
}  // namespace broadcl::test
