#include <broadcl/query.hpp>

#include <algorithm>
#include <array>
#include <cfenv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "boxes.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "expected_hits.hpp"
#include "expected_ranked_hits.hpp"
#include "rounding.hpp"

/// Queries of boxes, and partners of objects.
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

/// Small boxes and a few large ones, near enough to 0 and far enough from it that many overlap, in float64 by
/// less than float32 can tell.
template <class Box>
std::vector<Box> some_boxes(std::size_t n, unsigned seed) {
  using Bound = typename decltype(Box::lower)::value_type;
  constexpr Bound offset = std::is_same_v<Bound, double> ? Bound(1U << 27U) : Bound{0};
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> place(0, 40), size(0, 6), odd(0, 30);
  std::vector<Box> boxes(n);
  for (Box& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = offset + Bound(place(random)) / 2;
      box.upper[axis] = box.lower[axis] + Bound(size(random)) / 2;
    }
    const int kind = odd(random);
    if (kind == 0) box.lower[1] = box.upper[1] + 1;
    if (kind == 1) box.upper[2] = std::numeric_limits<Bound>::infinity();
    if (kind == 2) box.lower[0] = -std::numeric_limits<Bound>::infinity();
    if (kind == 3) box.upper[0] = box.lower[0] + 20;
  }
  return boxes;
}

/// Along axes, faces and diagonals, at any angle, and none at all.
/// @param starts Receives the boxes, made finite.
template <class Box>
Ways<Box> some_ways(const std::vector<Box>& boxes, std::vector<Box>& starts) {
  using Bound = BoundOf<Box>;
  std::mt19937 random(6);
  std::uniform_int_distribution<int> step(-2, 2), kind(0, 3);
  std::uniform_real_distribution<Bound> any(-9, 9);
  Ways<Box> ways;
  starts = boxes;
  for (Box& start : starts) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (std::isinf(start.lower[axis])) start.lower[axis] = start.upper[axis];
      if (std::isinf(start.upper[axis]) || kind(random) > 0) start.upper[axis] = start.lower[axis];
    }
    const bool is_straight = kind(random) > 0;
    auto& direction = ways.directions.emplace_back();
    for (Bound& component : direction)
      component = is_straight ? static_cast<Bound>(step(random)) : any(random);
    const std::array<Bound, 4> lengths{Bound{0}, Bound{1}, Bound{2.5},
                                       std::numeric_limits<Bound>::infinity()};
    ways.lengths.push_back(lengths.at(static_cast<std::size_t>(kind(random))));
  }
  return ways;
}

Filter some_filter(std::size_t number) {
  const auto k = static_cast<std::uint32_t>(number);
  return {.group = 1 + k % 3,
          .mask = k % 5 == 0 ? 2U : ~0U,
          .body = k % 4 == 0 ? k / 16 : Filter::no_body,
          .world = k % 11 == 0 ? Filter::all_worlds : k % 2};
}

/// A broad phase, and what it should have.
template <class Box>
class Asked {
 public:
  using Subject = BasicBroadPhase<Box>;

  Asked(const BroadPhase::Config& config, std::size_t queries, bool filters)
      : subject_(config), queries_(some_boxes<Box>(queries, 77)), has_filters_(filters) {
    for (std::size_t k = 0; k < queries_.size(); ++k) filters_.push_back(some_filter(3 * k + 1));
    ways_ = some_ways(queries_, starts_);
  }

  void add(std::span<const Box> boxes) {
    for (const Box& box : boxes) {
      const Filter filter = has_filters_ ? some_filter(objects_.boxes.size() + 2) : Filter();
      objects_.set(subject_.add(box, filter), box, filter);
    }
  }
  void move(std::uint32_t id, const Box& box) {
    subject_.move(id, box);
    objects_.boxes[id] = box;
  }
  void remove(std::uint32_t id) {
    subject_.remove(id);
    objects_.boxes[id].reset();
  }
  void set_filter(std::uint32_t id, const Filter& filter) {
    subject_.set_filter(id, filter);
    objects_.filters[id] = filter;
  }
  [[nodiscard]] Subject& subject() { return subject_; }
  [[nodiscard]] Objects<Box>& objects() { return objects_; }

  /// Asks in all ways.
  void expect_right(const std::string& when) {
    SCOPED_TRACE(when);
    std::vector<std::uint32_t> except;
    for (std::uint32_t k = 0; k < queries_.size(); ++k)
      except.push_back(static_cast<std::uint32_t>(7 * k % (objects_.boxes.size() + 2)));
    const std::span<const Filter> one = std::span(filters_).first(1);
    const std::array all{QueryOptions{},
                         QueryOptions{.filters = filters_},
                         QueryOptions{.filters = one, .limit = 3},
                         QueryOptions{.limit = 2, .except = except},
                         QueryOptions{.limit = 5, .count_only = true},
                         QueryOptions{.within = 1.25},
                         QueryOptions{.filters = filters_, .except = except, .within = 0}};
    for (const QueryOptions& options : all) {
      const Hits expected = expected_hits<Box>(objects_, queries_, options);
      const Hits hits = subject_.overlapping(BoxView(queries_), options);
      EXPECT_EQ(hits.offsets, expected.offsets);
      EXPECT_EQ(hits.ids, expected.ids);
      std::vector<std::uint32_t> ids{5, 6, 7};
      for (std::size_t k = 0; k < queries_.size(); k += 1 + queries_.size() / 16) {
        QueryOptions of_one = options;
        if (options.filters.size() > 1) of_one.filters = options.filters.subspan(k, 1);
        if (!options.except.empty()) of_one.except = options.except.subspan(k, 1);
        EXPECT_EQ(subject_.overlapping(queries_[k], ids, of_one),
                  expected.offsets[k + 1] - expected.offsets[k]);
        const std::span<const std::uint32_t> found =
            options.count_only ? std::span<const std::uint32_t>() : expected[k];
        EXPECT_TRUE(std::ranges::equal(ids, found)) << "query " << k;
      }
      if (options.limit == QueryOptions::all && !options.within) continue;
      expect_same_hits(subject_.nearest(BoxView(queries_), options),
                       expected_ranked_hits<Box>(objects_, queries_, nullptr, options));
      if (options.within) continue;
      expect_same_hits(subject_.along(BoxView(starts_), ways_.directions, ways_.lengths, options),
                       expected_ranked_hits<Box>(objects_, starts_, &ways_, options));
    }
  }

 private:
  Subject subject_;
  Objects<Box> objects_;
  std::vector<Box> queries_;
  std::vector<Box> starts_;
  Ways<Box> ways_;
  std::vector<Filter> filters_;
  bool has_filters_;
};

template <class Box>
void expect_life(const BroadPhase::Config& config, std::size_t n, std::size_t queries, bool filters) {
  SCOPED_TRACE(std::to_string(n) + " objects, " + std::to_string(queries) + " queries");
  Asked<Box> asked(config, queries, filters);
  asked.expect_right("without objects");
  const std::vector<Box> boxes = some_boxes<Box>(n, 1);
  const std::vector<Box> others = some_boxes<Box>(n, 2);
  asked.add(boxes);
  asked.expect_right("before the first update");
  (void)asked.subject().update();
  asked.expect_right("after it");
  for (std::uint32_t id = 0; id < n; id += 23) asked.move(id, others[id]);
  for (std::uint32_t id = 1; id < n; id += 31) asked.remove(id);
  asked.expect_right("with changes");
  asked.add(std::span(others).first(7));
  if (filters) asked.set_filter(0, {.world = 1});
  asked.expect_right("with more changes");
  asked.subject().begin();
  asked.expect_right("after begin");
  for (std::uint32_t id = 0; id < n; id += 46) asked.move(id, boxes[id]);
  for (std::uint32_t id = 2; id < n; id += 31) asked.remove(id);
  asked.add(std::span(others).last(n / 2));
  asked.expect_right("with changes after begin");
  (void)asked.subject().finish();
  asked.expect_right("with changes after finish");
  (void)asked.subject().update();
  asked.expect_right("after another update");
  asked.move(0, others[1]);
  asked.subject().shrink();
  asked.expect_right("after shrink");
  (void)asked.subject().update();
  (void)asked.subject().update(BoxView(others));
  asked.objects().replace(others);
  asked.expect_right("after an update with boxes");
  asked.subject().begin(BoxView(boxes));
  asked.objects().replace(boxes);
  asked.expect_right("after begin with boxes");
  (void)asked.subject().finish();
  const std::span<Box> mapped = asked.subject().map(n + 3);
  asked.objects().resize(n + 3);
  asked.expect_right("after map");
  for (std::uint32_t id = 0; id < n; id += 2) {
    mapped[id] = others[id];
    asked.objects().boxes[id] = others[id];
  }
  asked.expect_right("with boxes in place");
  (void)asked.subject().update();
  asked.expect_right("at the end");
}

TEST_P(EachAlgorithm, QueriesFindWhatTheyShouldWhateverChanges) {
  expect_life<Aabb>(config(), 150, 9, false);
  expect_life<Aabb>(config(), 531, 80, true);
  expect_life<Aabb64>(config(), 150, 30, false);
  if (is_slow() || GetParam().on_device) return;
  expect_life<Aabb64>(config(), 1301, 30, true);
}

TEST_P(EachAlgorithm, QueriesOfTwoSetsLookInBoth) {
  Asked<Aabb> asked(config(), 100, false);
  const std::vector<Aabb> boxes = some_boxes<Aabb>(500, 1);
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    Filter filter = k % 2 == 0 ? Filter::first_set : Filter::second_set;
    filter.world = k % 3 == 0 ? 1 : 0;
    asked.objects().set(asked.subject().add(boxes[k], filter), boxes[k], filter);
  }
  (void)asked.subject().update();
  asked.expect_right("after an update");
  asked.move(7, boxes[8]);
  asked.expect_right("with a change");
}

TEST_P(EachAlgorithm, PartnersAreThoseOfThePairs) {
  const auto expect_partners = [](const auto& subject, std::uint32_t ids) {
    const std::vector<Pair> pairs = subject.pairs();
    std::vector<std::vector<std::uint32_t>> expected(ids);
    for (const Pair& pair : pairs) {
      if (pair.a < ids) expected[pair.a].push_back(pair.b);
      if (pair.b < ids) expected[pair.b].push_back(pair.a);
    }
    for (std::uint32_t id = 0; id < ids; ++id) {
      if (!subject.contains(id)) continue;
      std::ranges::sort(expected[id]);
      EXPECT_EQ(subject.partners(id), expected[id]) << id;
    }
  };
  BroadPhase64 subject(config());
  const std::vector<Aabb64> boxes = some_boxes<Aabb64>(300, 5);
  (void)subject.add(boxes);
  EXPECT_TRUE(subject.partners(3).empty());
  (void)subject.update();
  expect_partners(subject, 300);
  EXPECT_GT(subject.pairs().size(), 100U);
  subject.remove(17);
  const std::uint32_t last = subject.add(boxes[0]) + subject.add(boxes[0]);
  expect_partners(subject, last - 17 + 1);
  subject.begin();
  EXPECT_THAT(error_of([&] { (void)subject.partners(1); }), HasSubstr("finish()"));
  (void)subject.finish();
  expect_partners(subject, 301);
  subject.shrink();
  expect_partners(subject, 301);
  EXPECT_THAT(error_of([&] { (void)subject.partners(9999); }), HasSubstr("no object has the id 9999"));
}

TEST(Queries, OfBoxesThatAreUsedOnce) {
  for (const std::size_t n : {0U, 1U, 33U, 500U, 2001U}) {
    for (const std::size_t m : {0U, 1U, 40U, 401U}) {
      SCOPED_TRACE(std::to_string(n) + " boxes, " + std::to_string(m) + " queries");
      const auto boxes = some_boxes<Aabb64>(n, 1);
      const auto queries = some_boxes<Aabb64>(m, 2);
      Objects<Aabb64> objects;
      objects.replace(boxes);
      const Hits expected = expected_hits<Aabb64>(objects, queries, {});
      const Hits hits = overlapping(BoxView(boxes), BoxView(queries));
      EXPECT_EQ(hits.offsets, expected.offsets);
      EXPECT_EQ(hits.ids, expected.ids);
      EXPECT_EQ(hits.size(), m);
      const auto boxes32 = some_boxes<Aabb>(n, 1);
      const auto queries32 = some_boxes<Aabb>(m, 2);
      Objects<Aabb> objects32;
      objects32.replace(boxes32);
      const QueryOptions options{.limit = 4, .within = 0.5};
      EXPECT_EQ(overlapping(BoxView(boxes32), BoxView(queries32), options).ids,
                expected_hits<Aabb>(objects32, queries32, options).ids);
    }
  }
  // One of the two in float64 makes both of that.
  const std::vector<Aabb> one{{{0, 0, 0}, {1, 1, 1}}};
  const double next = 1 + 1e-12;
  const std::vector<Aabb64> near{{{next, 0, 0}, {2, 1, 1}}};
  EXPECT_TRUE(overlapping(BoxView(one), BoxView(near)).ids.empty());
  EXPECT_TRUE(overlapping(BoxView(near), BoxView(one)).ids.empty());
}

TEST(Queries, RefuseWhatTheyCannotUse) {
  BroadPhase subject;
  (void)subject.add(unit);
  std::vector<std::uint32_t> ids{1, 2, 3};
  const std::vector<Aabb> two{unit, {{0, nan_value, 0}, {1, 1, 1}}};
  const auto batch = [&](const QueryOptions& options, std::span<const Aabb> boxes) {
    return error_of([&] { (void)subject.overlapping(BoxView(boxes), options); });
  };
  EXPECT_THAT(batch({}, two), HasSubstr("box 1 has a NaN"));
  EXPECT_THAT(error_of([&] { (void)subject.overlapping(two[1], ids); }), HasSubstr("NaN"));
  EXPECT_THAT(error_of([&] { (void)overlapping(BoxView(two), BoxView(two)); }),
              HasSubstr("the boxes: box 1 has a NaN"));
  EXPECT_THAT(error_of([&] { (void)overlapping({}, BoxView(two)); }), HasSubstr("the queries: box 1 has a"));
  const std::array<Filter, 3> filters{};
  const std::array<std::uint32_t, 3> except{};
  EXPECT_THAT(batch({.filters = filters}, std::span(two).first(1)), HasSubstr("3 filters for 1 queries"));
  EXPECT_THAT(batch({.except = except}, std::span(two).first(1)), HasSubstr("3 exceptions for 1 queries"));
  for (const double within : {-1.0, 1e19, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THAT(batch({.within = within}, std::span(two).first(1)), HasSubstr("from 0 to 2^62"));
  }
  EXPECT_THAT(error_of([&] { (void)overlapping({}, {}, {}, {.algorithm = "unknown"}); }),
              HasSubstr("no algorithm is named"));
  EXPECT_EQ(ids, (std::vector<std::uint32_t>{1, 2, 3}));
}

TEST(Queries, TooManyHitsAreAnErrorAndNotCutOff) {
  BroadPhase subject;
  for (int k = 0; k < 100; ++k) (void)subject.add(unit);
  const std::vector<Aabb> queries(10, unit);
  EXPECT_EQ(subject.overlapping(BoxView(queries), {.most_hits = 1000}).ids.size(), 1000U);
  for (const bool counts : {false, true}) {
    const QueryOptions options{.most_hits = 999, .count_only = counts};
    EXPECT_THAT(error_of([&] { (void)subject.overlapping(BoxView(queries), options); }),
                HasSubstr("more than 999"));
  }
  std::vector<std::uint32_t> ids{4};
  EXPECT_THAT(error_of([&] { (void)subject.overlapping(unit, ids, {.most_hits = 99}); }),
              HasSubstr("more than 99"));
  EXPECT_EQ(ids, std::vector<std::uint32_t>{4});
  EXPECT_EQ(subject.overlapping(BoxView(queries), {.limit = 99, .most_hits = 990}).ids.size(), 990U);
}

TEST(Queries, AnObjectFindsItselfUnlessItIsExcepted) {
  BroadPhase subject({.algorithm = "sweep-and-prune"});
  std::vector<Aabb> boxes;
  for (std::size_t k = 0; k < 1000; ++k) boxes.push_back(apart(k));
  const std::vector<std::uint32_t> ids = subject.add(boxes);
  (void)subject.update();
  const Hits all = subject.overlapping(BoxView(boxes));
  EXPECT_EQ(all.ids, ids);
  EXPECT_TRUE(subject.overlapping(BoxView(boxes), {.except = ids}).ids.empty());
}

/// A query without end finds all but empty boxes, also in tiles that are not full.
TEST(Queries, EmptyBoxesAndWhatIsNotThereAreNeverFound) {
  const Aabb everywhere{{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}};
  for (const std::size_t n : {1U, 5U, 31U, 65U, 500U, 1111U}) {
    BroadPhase subject({.algorithm = "sweep-and-prune"});
    std::vector<std::uint32_t> expected;
    for (std::size_t k = 0; k < n; ++k) {
      const std::uint32_t id = subject.add(k % 7 == 3 ? empty_aabb() : apart(k));
      if (k % 7 != 3) expected.push_back(id);
    }
    for (int update = 0; update < 2; ++update) {
      std::vector<std::uint32_t> ids;
      EXPECT_EQ(subject.overlapping(everywhere, ids), expected.size());
      EXPECT_EQ(ids, expected);
      (void)subject.overlapping(everywhere, ids, {.within = 1});
      EXPECT_EQ(ids, expected);
      EXPECT_EQ(subject.overlapping(empty_aabb(), ids), 0U);
      EXPECT_EQ(subject.overlapping(inverted, ids, {.within = 1e18}), 0U);
      const std::vector<Aabb> many(100, everywhere);
      EXPECT_EQ(subject.overlapping(BoxView(many)).ids.size(), 100 * expected.size());
      (void)subject.update();
    }
  }
}

TEST(Queries, OfEmptyBoxesFindNothingThatIsInfinite) {
  constexpr Aabb everything{{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}};
  const std::vector<Aabb> objects(300, everything);
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  (void)broad_phase.add(objects);
  (void)broad_phase.update();
  for (const std::size_t n : {1U, 3U, 200U}) {
    const std::vector<Aabb> queries(n, empty_aabb());
    EXPECT_TRUE(broad_phase.overlapping(queries).ids.empty()) << n;
  }
}

TEST(Queries, FindNoIdThatMapLeftFree) {
  constexpr Aabb everything{{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}};
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  (void)broad_phase.map(62);
  broad_phase.remove(60);
  for (Aabb& box : broad_phase.map(56)) box = {{0, 0, 0}, {1, 1, 1}};
  (void)broad_phase.update();
  for (const std::size_t n : {1U, 100U}) {
    const std::vector<Aabb> queries(n, everything);
    EXPECT_EQ(broad_phase.overlapping(queries).ids.size(), n * 56);
  }
}

TEST(Queries, InDoublePrecisionFindWhatIsNearerThanImagesTell) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> place(1'048'576, 1'058'576);
  std::uniform_real_distribution<double> part(-1, 1);
  constexpr double reach = 0.05;
  std::vector<Aabb64> objects(3000);
  std::vector<Aabb64> queries(objects.size());
  for (std::size_t k = 0; k < objects.size(); ++k) {
    std::array<double, 3> step{part(random), part(random), part(random)};
    const double length = std::hypot(step[0], step[1], step[2]);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double at = part(random) < 0 ? -place(random) : place(random);
      objects[k].lower[axis] = objects[k].upper[axis] = at;
      queries[k].lower[axis] = queries[k].upper[axis] = at + step.at(axis) / length * reach * 0.998;
    }
  }
  BroadPhase64 broad_phase({.algorithm = "sweep-and-prune"});
  (void)broad_phase.add(objects, {{Filter()}}, {{reach}});
  (void)broad_phase.update();
  const Hits hits = broad_phase.overlapping(queries);
  for (std::uint32_t k = 0; k < objects.size(); ++k) EXPECT_TRUE(std::ranges::count(hits[k], k) == 1) << k;
}

TEST(Queries, DoNotDependOnTheRoundingMode) {
  constexpr double within = 0.1;
  const auto gap = static_cast<float>(within);  // above it
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  (void)broad_phase.add({{gap, 0, 0}, {1, 1, 1}});
  std::vector<std::uint32_t> ids;
  const ScopedRounding rounding(FE_DOWNWARD);
  EXPECT_EQ(broad_phase.overlapping({{0, 0, 0}, {0, 0, 0}}, ids, {.within = within}), 1U);
}

TEST_P(EachAlgorithm, SeveralThreadsMayAsk) {
  BroadPhase subject(config());
  const std::vector<Aabb> boxes = some_boxes<Aabb>(1000, 3);
  (void)subject.add(boxes);
  Objects<Aabb> objects;
  objects.replace(boxes);
  const std::vector<Aabb> queries = some_boxes<Aabb>(300, 4);
  for (int round = 0; round < 3; ++round) {
    for (std::uint32_t id = 0; round > 0 && id < 250; ++id) {
      subject.move(id, boxes[id + 1]);
      objects.boxes[id] = boxes[id + 1];
    }
    const Hits expected = expected_hits<Aabb>(objects, queries, {});
    std::array<std::thread, 4> threads;
    for (std::size_t thread = 0; thread < threads.size(); ++thread) {
      threads.at(thread) = std::thread([&, thread] {
        std::vector<std::uint32_t> ids;
        for (std::size_t k = 0; k < queries.size(); ++k) {
          (void)subject.overlapping(queries[k], ids);
          EXPECT_TRUE(std::ranges::equal(ids, expected[k]));
          if (k % 100 == 0 && thread % 2 == 0) {
            EXPECT_EQ(subject.overlapping(BoxView(queries)).ids, expected.ids);
          }
          (void)subject.partners(0);
        }
      });
    }
    for (std::thread& thread : threads) thread.join();
    (void)subject.update();
  }
}

}  // namespace
}  // namespace broadcl::test
