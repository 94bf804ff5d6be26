#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <random>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "base/coordinate_map.hpp"
#include "base/distance.hpp"
#include "core/exact_reaches.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "near.hpp"
#include "rounding.hpp"

/// Objects that reach beyond their boxes, and pairs within a distance.
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

template <class Box>
struct Object {
  Box box{};
  BoundOf<Box> reach = 0;
  int birth = 0;
};

/// A broad phase and the objects that it must have, by id.
template <class Box>
class Subject {
 public:
  using Bound = BoundOf<Box>;
  using BroadPhaseOf = BasicBroadPhase<Box>;

  explicit Subject(const Config& config)
      : broad_phase(config), distance_(static_cast<Bound>(config.distance)) {}

  void add(const Box& box, Bound reach = 0) {
    const std::uint32_t id = broad_phase.add(box, {}, reach);
    objects[id] = {box, distance_ > 0 ? distance_ / 2 : reach, ++births_};
  }
  void remove(std::uint32_t id) {
    broad_phase.remove(id);
    objects.erase(id);
  }
  void move(std::uint32_t id, const Box& box) {
    broad_phase.move(id, box);
    objects.at(id).box = box;
  }
  void set_reach(const std::vector<std::uint32_t>& ids, const std::vector<Bound>& reaches) {
    broad_phase.set_reach(ids, reaches);
    for (std::size_t k = 0; k < ids.size(); ++k)
      objects.at(ids[k]).reach = reaches[reaches.size() == 1 ? 0 : k];
  }

  void begin() {
    broad_phase.begin();
    begun_ = objects;
  }
  void update(const std::string& what) {
    const Delta delta = begun_.empty() ? broad_phase.update() : broad_phase.finish();
    expect(delta, begun_.empty() ? objects : begun_, what);
    begun_.clear();
  }
  /// With new boxes for all objects.
  void update(const std::vector<Box>& boxes, const std::string& what) {
    const Delta delta = broad_phase.update(boxes);
    for (auto object = objects.begin(); object != objects.end();)
      object = object->first < boxes.size() ? std::next(object) : objects.erase(object);
    for (std::uint32_t id = 0; id < boxes.size(); ++id) {
      if (!objects.contains(id)) objects[id] = {boxes[id], distance_ / 2, ++births_};
      objects[id].box = boxes[id];
    }
    expect(delta, objects, what);
  }

  BroadPhaseOf broad_phase;
  std::map<std::uint32_t, Object<Box>> objects;

 private:
  void expect(const Delta& delta, const std::map<std::uint32_t, Object<Box>>& state,
              const std::string& what) {
    const ScopedRounding rounding(FE_TONEAREST);
    std::map<Pair, std::pair<int, int>> known;  // the births of both
    for (const auto& [b, t] : state) {
      for (const auto& [a, s] : state) {
        if (a < b && are_near(s.box, t.box, s.reach, t.reach)) known[{a, b}] = {s.birth, t.birth};
      }
    }
    Pairs added;
    Pairs removed;
    Pairs pairs;
    for (const auto& [pair, births] : known) {
      pairs.push_back(pair);
      const auto before = known_.find(pair);
      if (before == known_.end() || before->second != births) added.push_back(pair);
    }
    for (const auto& [pair, births] : known_) {
      const auto now = known.find(pair);
      if (now == known.end() || now->second != births) removed.push_back(pair);
    }
    EXPECT_TRUE(same(delta, added, removed)) << what;
    EXPECT_TRUE(same("pairs", broad_phase.pairs(), pairs)) << what;
    for (const auto& [id, object] : objects) EXPECT_EQ(broad_phase.reach(id), object.reach) << what;
    known_ = std::move(known);
  }

  Bound distance_;
  std::map<Pair, std::pair<int, int>> known_;
  std::map<std::uint32_t, Object<Box>> begun_;
  int births_ = 0;
};

/// What bounds and reaches are.
enum class Numbers {
  uniform,
  points,
  integers,
  grid,
  infinite,
  tiny,
  huge,
  limits,
  far_limits,
  far,
  clusters,
  count
};

template <class Box>
class Scene {
 public:
  using Bound = BoundOf<Box>;
  Scene(Numbers numbers, std::uint32_t seed) : numbers_(numbers), random_(seed) {}

  Box box() {
    Box box;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = bound();
      box.upper[axis] = box.lower[axis] + (is_point() ? 0 : size());
      if (numbers_ == Numbers::infinite && below(4) == 0) box.lower[axis] = -infinite;
      if (numbers_ == Numbers::infinite && below(4) == 0) box.upper[axis] = infinite;
      if (numbers_ == Numbers::infinite && below(20) == 0) box.lower[axis] = box.upper[axis];
    }
    if (below(40) == 0) box.lower[0] = box.upper[0] + 1;
    return box;
  }

  Bound reach() {
    if (is_at_limit()) return static_cast<Bound>(std::ldexp(limit_distance, -1));
    if (below(3) == 0) return 0;
    switch (numbers_) {
      case Numbers::integers:
        return static_cast<Bound>(below(6)) / 2;
      case Numbers::grid:
        return static_cast<Bound>(below(4)) / 3;
      case Numbers::tiny:
        return static_cast<Bound>(
            std::ldexp(1 + below(3), below(8) == 0 ? -140 : -65 + static_cast<int>(below(3))));
      case Numbers::huge:
        return static_cast<Bound>(below(2) == 0 ? 0x1p62 : fraction() * 0x1p62);
      case Numbers::infinite:
        return static_cast<Bound>(below(10) == 0 ? 0x1p62 : fraction());
      default:
        return static_cast<Bound>(below(20) == 0 ? 4 * fraction() : fraction() / 2);
    }
  }

  std::uint32_t below(std::uint32_t limit) {
    return std::uniform_int_distribution<std::uint32_t>(0, limit - 1)(random_);
  }

 private:
  static constexpr Bound infinite = std::numeric_limits<Bound>::infinity();
  static constexpr double limit_distance = 1.1;

  [[nodiscard]] bool is_point() { return numbers_ == Numbers::points || is_at_limit() || below(3) == 0; }
  [[nodiscard]] bool is_at_limit() const {
    return numbers_ == Numbers::limits || numbers_ == Numbers::far_limits;
  }
  double fraction() { return std::uniform_real_distribution<double>(0, 1)(random_); }
  Bound size() {
    if (numbers_ == Numbers::integers) return static_cast<Bound>(below(3));
    if (numbers_ == Numbers::tiny) return static_cast<Bound>(std::ldexp(below(3), -64));
    if (numbers_ == Numbers::huge) return static_cast<Bound>(fraction() * 0x1p61);
    return static_cast<Bound>(fraction());
  }
  Bound bound() {
    switch (numbers_) {
      case Numbers::integers:
        return static_cast<Bound>(below(16));
      case Numbers::grid:
        return static_cast<Bound>(below(20)) / 3;
      case Numbers::tiny:
        return static_cast<Bound>(
            std::ldexp(static_cast<double>(below(9)) - 4, -64 - 80 * static_cast<int>(below(2))));
      case Numbers::huge:
        return static_cast<Bound>((fraction() - 0.5) * 0x1p66);
      case Numbers::limits:  // on a line, distances of the limit and a few ulps
        return static_cast<Bound>(limit_distance *
                                  (below(6) + std::ldexp(static_cast<double>(below(9)) - 4,
                                                         std::is_same_v<Bound, float> ? -23 : -52)));
      case Numbers::far_limits:
        return static_cast<Bound>(1e7 + limit_distance * below(6) +
                                  std::ldexp(static_cast<double>(below(9)) - 4, -30));
      case Numbers::far:
        return static_cast<Bound>(1e7 + 6 * fraction());
      case Numbers::clusters:
        return static_cast<Bound>((below(2) == 0 ? -3e6 : 3e6) + 4 * fraction());
      default:
        return static_cast<Bound>(9 * fraction());
    }
  }

  Numbers numbers_;
  std::mt19937 random_;
};

/// The life of some objects.
template <class Box>
void expect_life(const Config& config, Numbers numbers, std::size_t objects) {
  Scene<Box> scene(numbers, static_cast<std::uint32_t>(objects) + static_cast<std::uint32_t>(numbers));
  const bool own = config.distance == 0;
  const auto reach = [&] { return own ? scene.reach() : 0; };
  Subject<Box> subject(config);
  const auto some = [&] {
    std::vector<std::uint32_t> ids;
    for (const auto& [id, object] : subject.objects) {
      if (scene.below(12) == 0) ids.push_back(id);
    }
    return ids;
  };
  for (std::size_t k = 0; k < objects; ++k) subject.add(scene.box());
  subject.update("without reaches");
  for (int round = 0; round < 12; ++round) {
    const std::string what = "numbers " + std::to_string(static_cast<int>(numbers)) + ", " +
                             std::to_string(objects) + " objects, round " + std::to_string(round);
    const ScopedRounding rounding(rounding_modes.at(static_cast<std::size_t>(round) % rounding_modes.size()));
    if (own) {
      const std::vector<std::uint32_t> ids = some();
      std::vector<BoundOf<Box>> reaches;
      for (std::size_t k = 0; k < ids.size(); ++k) reaches.push_back(reach());
      if (!ids.empty()) subject.set_reach(ids, reaches);
    }
    if (round % 3 == 1) {
      for (const std::uint32_t id : some()) subject.remove(id);
      while (subject.objects.size() < objects) subject.add(scene.box(), reach());
    }
    if (round % 4 == 3) subject.begin();
    for (const std::uint32_t id : some()) subject.move(id, scene.box());
    if (own && round % 4 == 3) subject.set_reach(some(), {reach()});
    subject.update(what);
    if (round % 5 == 2) {
      std::vector<Box> boxes(objects + static_cast<std::size_t>(round));
      for (Box& box : boxes) box = scene.box();
      subject.update(boxes, what + ", all boxes");
    }
    if (round == 7) subject.broad_phase.shrink();
  }
}

template <class Box>
void expect_lives(Config config, bool is_slow) {
  for (int numbers = 0; numbers < static_cast<int>(Numbers::count); ++numbers) {
    for (const double distance : {0.0, 1.1}) {
      config.distance = distance;
      for (const std::size_t objects : {20U, 150U, 300U}) {
        if (objects > 150 && is_slow) continue;
        expect_life<Box>(config, static_cast<Numbers>(numbers), objects);
      }
    }
  }
}

TEST_P(EachAlgorithm, ObjectsReachBeyondTheirBoxes) {
  expect_lives<Aabb>(config(), is_slow() || GetParam().on_device || GetParam().name == "auto");
}

TEST_P(EachAlgorithm, ObjectsReachBeyondTheirBoxesInDoublePrecision) {
  expect_lives<Aabb64>(config(), is_slow() || GetParam().on_device || GetParam().name == "auto");
}

template <class Box>
void expect_pairs_of_one_search(Config config, bool is_slow) {
  for (int numbers = 0; numbers < static_cast<int>(Numbers::count); ++numbers) {
    for (const std::size_t count : {10U, 120U, 300U}) {
      if (count > 120 && is_slow) continue;
      Scene<Box> scene(static_cast<Numbers>(numbers), static_cast<std::uint32_t>(count));
      std::vector<Box> boxes(count);
      for (Box& box : boxes) box = scene.box();
      for (const double distance : {0.0, 0x1p-64, 0x1p-63, 1.0, 1.1, 0x1p63}) {
        const auto reach = static_cast<BoundOf<Box>>(distance) / 2;
        const auto expected = [&](std::size_t first) {
          Pairs pairs;  // of a box below `first` and another one
          for (std::uint32_t b = 0; b < count; ++b) {
            for (std::uint32_t a = 0; a < std::min<std::size_t>(b, first); ++a) {
              if ((first == count || b >= first) && are_near(boxes[a], boxes[b], reach, reach))
                pairs.push_back({a, b});
            }
          }
          return pairs;
        };
        const std::string what = "numbers " + std::to_string(numbers) + ", " + std::to_string(count) +
                                 " boxes within " + std::to_string(distance);
        config.distance = distance;
        EXPECT_TRUE(same("pairs", overlapping_pairs(boxes, {}, config), expected(count))) << what;
        const std::size_t first = count / 3;
        Pairs pairs = overlapping_pairs(BoxView(std::span(boxes).first(first)),
                                        BoxView(std::span(boxes).subspan(first)), {}, config);
        for (Pair& pair : pairs) pair.b += static_cast<std::uint32_t>(first);
        EXPECT_TRUE(same("pairs of two sets", pairs, expected(first))) << what;
      }
    }
  }
}

TEST_P(EachAlgorithm, PairsWithinADistance) {
  expect_pairs_of_one_search<Aabb>(config(), is_slow() || GetParam().on_device || GetParam().name == "auto");
}

TEST_P(EachAlgorithm, PairsWithinADistanceInDoublePrecision) {
  expect_pairs_of_one_search<Aabb64>(config(),
                                     is_slow() || GetParam().on_device || GetParam().name == "auto");
}

/// Boxes and reaches that are as far apart as the reaches allow, but for a few ulps.
template <class Box>
class AtLimit {
 public:
  using Bound = BoundOf<Box>;

  Box s, t;
  Bound reach_s = 0, reach_t = 0;

  /// @param scale Its numbers are about 2 to the power of this.
  void next(int scale) {
    const auto number = [&](double least, double most) {
      return static_cast<Bound>(
          std::ldexp(std::uniform_real_distribution<double>(least, most)(random_), scale));
    };
    reach_s = random_() % 4 == 0 ? 0 : number(0, 1);
    reach_t = random_() % 4 == 0 ? std::ldexp(number(0, 1), -12) : number(0, 1);
    std::array<double, 3> direction{};
    double length = 0;
    for (double& along : direction) {
      if (random_() % 3 != 0) along = std::uniform_real_distribution<double>(-1, 1)(random_);
      length = std::hypot(length, along);
    }
    if (length == 0) direction[0] = length = 1;
    const int far = random_() % 2 == 0 ? 0 : static_cast<int>(random_() % 20);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto gap =
          static_cast<Bound>(static_cast<double>(reach_s + reach_t) * (direction.at(axis) / length));
      s.lower[axis] = std::ldexp(number(-1, 1), far);
      s.upper[axis] = s.lower[axis] + number(0, 1);
      t.lower[axis] = gap < 0 ? s.lower[axis] + gap : s.upper[axis] + gap;
      if (gap == 0) t.lower[axis] = s.lower[axis];
      t.upper[axis] = t.lower[axis];
      (gap < 0 ? t.lower[axis] : t.upper[axis]) += gap < 0 ? -number(0, 1) : number(0, 1);
      const int ulps = static_cast<int>(random_() % 5) - 2;
      Bound& nearest = gap < 0 ? t.upper[axis] : t.lower[axis];
      for (int k = 0; k < std::abs(ulps); ++k)
        nearest = std::nextafter(nearest, static_cast<Bound>(ulps) * std::numeric_limits<Bound>::infinity());
      if (t.upper[axis] < t.lower[axis]) t.upper[axis] = t.lower[axis];
    }
  }

 private:
  std::mt19937 random_{3};
};

template <class Box>
void expect_that_grown_boxes_overlap() {
  AtLimit<Box> pair;
  std::size_t within = 0;
  constexpr std::size_t pairs = is_sanitized ? 100'000 : 2'000'000;
  for (std::size_t k = 0; k < pairs; ++k) {
    pair.next(static_cast<int>(k % 40) - 20);
    if (!is_within(pair.s, pair.t, pair.reach_s + pair.reach_t)) continue;
    ++within;
    ASSERT_TRUE(packed_overlaps(grown(pair.s, pair.reach_s), grown(pair.t, pair.reach_t))) << k;
  }
  EXPECT_GT(within, pairs / 4);
  EXPECT_LT(within, pairs * 3 / 4);
}

TEST(Reach, GrownBoxesOverlapIfBoxesAreWithinReach) {
  expect_that_grown_boxes_overlap<Aabb>();
  expect_that_grown_boxes_overlap<Aabb64>();
}

/// In float32, all pairs are found, and what is not in doubt is a pair.
TEST(Reach, ImagesTellWhichPairsAreInDoubt) {
  AtLimit<Aabb64> pair;
  std::mt19937 random(5);
  std::size_t doubtful = 0;
  std::size_t sure = 0;
  for (int scene = 0; scene < (is_sanitized ? 200 : 4000); ++scene) {
    std::vector<Aabb64> boxes;
    std::vector<double> reaches;
    for (int k = 0; k < 50; ++k) {
      pair.next(scene % 40 - 20);
      const double other = std::uniform_real_distribution<double>(-1, 1)(random);
      if (k % 2 == 0) pair.reach_s *= 1 + std::ldexp(other, -static_cast<int>(random() % 24));
      boxes.insert(boxes.end(), {pair.s, pair.t});
      reaches.insert(reaches.end(), {pair.reach_s, pair.reach_t});
    }
    const auto read = [&](std::size_t first, std::span<Aabb64> out) {
      std::copy_n(boxes.begin() + static_cast<std::ptrdiff_t>(first), out.size(), out.begin());
    };
    const CoordinateMap map(boxes.size(), read, true, 1);
    std::vector<Aabb> images(boxes.size());
    (void)map.convert(boxes, images);
    for (std::size_t k = 0; k < boxes.size(); k += 2) {
      const float reach =
          reach_of_image(images[k], reaches[k]) + reach_of_image(images[k + 1], reaches[k + 1]);
      const bool are_pair = is_within(boxes[k], boxes[k + 1], reaches[k] + reaches[k + 1]);
      const bool are_found = is_within(images[k], images[k + 1], reach);
      ASSERT_TRUE(are_found || !are_pair) << scene;
      if (!are_found) continue;
      const bool in_doubt = is_in_doubt(images[k], images[k + 1], reach);
      ASSERT_TRUE(in_doubt || are_pair) << scene;
      ++(in_doubt ? doubtful : sure);
    }
  }
  EXPECT_GT(doubtful, sure / 20);
  EXPECT_GT(sure, doubtful / 100);
}

TEST(Reach, ThreadsFindTheSame) {
  Scene<Aabb> scene(Numbers::points, 11);
  std::vector<Aabb> boxes(9000);
  for (Aabb& box : boxes) {
    box = scene.box();
    box.lower[2] += 0.01F * static_cast<float>(&box - boxes.data());
    box.upper[2] = box.lower[2];
  }
  const Pairs expected = overlapping_pairs(boxes, {}, {.algorithm = "oracle", .distance = 0.3});
  const ScopedRounding rounding(FE_UPWARD);
  for (const std::size_t threads : {1U, 4U}) {
    const BroadPhase::Config config{.algorithm = "sweep-and-prune", .threads = threads, .distance = 0.3};
    EXPECT_TRUE(same("pairs", overlapping_pairs(boxes, {}, config), expected)) << threads;
    BroadPhase broad_phase(config);
    EXPECT_TRUE(same("added", broad_phase.update(boxes).added, expected)) << threads;
  }
}

template <class Number>
class ReachOf : public ::testing::Test {};
using Precisions = ::testing::Types<Aabb, Aabb64>;
TYPED_TEST_SUITE(ReachOf, Precisions);

TYPED_TEST(ReachOf, InvalidOnesAreRefused) {
  using Bound = BoundOf<TypeParam>;
  BasicBroadPhase<TypeParam> broad_phase({.algorithm = "sweep-and-prune"});
  const TypeParam box{{0, 0, 0}, {1, 1, 1}};
  const TypeParam other{{3, 0, 0}, {4, 1, 1}};
  const std::vector<std::uint32_t> ids{broad_phase.add(box, {}, 1), broad_phase.add(other)};
  const std::vector<TypeParam> boxes{box, other};
  const auto refused = [&](Bound reach) {
    const std::vector<Bound> reaches{1, reach};
    EXPECT_THAT(error_of([&] { broad_phase.set_reach(ids, reaches); }), HasSubstr("give one from 0 to 2^62"));
    EXPECT_THAT(error_of([&] { broad_phase.add(box, {}, reach); }), HasSubstr("give one from 0 to 2^62"));
    EXPECT_THAT(error_of([&] { broad_phase.add(boxes, std::vector<Filter>(1), reaches); }),
                HasSubstr("give one from 0 to 2^62"));
  };
  for (const Bound reach :
       {Bound{-1}, std::numeric_limits<Bound>::quiet_NaN(), std::numeric_limits<Bound>::infinity(),
        std::nextafter(static_cast<Bound>(0x1p62), std::numeric_limits<Bound>::infinity())})
    refused(reach);
  const std::vector<Bound> three(3);
  EXPECT_THAT(error_of([&] { broad_phase.set_reach(ids, three); }), HasSubstr("3 reaches for 2 objects"));
  EXPECT_THAT(error_of([&] { broad_phase.set_reach(ids, {}); }), HasSubstr("0 reaches for 2 objects"));
  const std::vector<std::uint32_t> unknown{0, 7};
  EXPECT_THAT(error_of([&] { broad_phase.set_reach(unknown, std::vector<Bound>{2}); }),
              HasSubstr("no object has the id 7"));
  EXPECT_EQ(broad_phase.size(), 2U);
  EXPECT_EQ(broad_phase.reach(0), 1);
  EXPECT_EQ(broad_phase.reach(1), 0);
  EXPECT_THAT(error_of([&] { (void)broad_phase.reach(2); }), HasSubstr("no object has the id 2"));
  EXPECT_TRUE(broad_phase.update().added.empty());
  broad_phase.set_reach(std::vector<std::uint32_t>{1, 1, 1}, std::vector<Bound>{0, 2, 1});
  EXPECT_EQ(to_vector(broad_phase.update().added), (Pairs{{0, 1}}));
  EXPECT_EQ(broad_phase.box(0).upper[0], 1);
  broad_phase.remove(0);
  EXPECT_EQ(broad_phase.add(box), 0U);
  EXPECT_EQ(broad_phase.reach(0), 0);
  EXPECT_EQ(to_vector(broad_phase.update().removed), (Pairs{{0, 1}}));
}

TYPED_TEST(ReachOf, ADistanceLeavesNoChoice) {
  using Bound = BoundOf<TypeParam>;
  BasicBroadPhase<TypeParam> broad_phase({.algorithm = "sweep-and-prune", .distance = 1.1});
  const std::vector<TypeParam> boxes(2);
  const std::vector<std::uint32_t> ids = broad_phase.add(boxes);
  EXPECT_EQ(broad_phase.reach(1), static_cast<Bound>(1.1) / 2);
  EXPECT_THAT(error_of([&] { broad_phase.set_reach(ids, std::vector<Bound>{0}); }),
              HasSubstr("Config::distance"));
  EXPECT_THAT(error_of([&] { broad_phase.add(TypeParam(), {}, 1); }), HasSubstr("Config::distance"));
  EXPECT_EQ(broad_phase.size(), 2U);
  for (const double distance : {-1.0, std::nan(""), std::ldexp(1, 64)}) {
    const BroadPhase::Config config{.algorithm = "sweep-and-prune", .distance = distance};
    EXPECT_THAT(error_of([&] { BasicBroadPhase<TypeParam> refused(config); }),
                HasSubstr("give one from 0 to 2^63"));
    EXPECT_THAT(error_of([&] { (void)overlapping_pairs(boxes, {}, config); }),
                HasSubstr("give one from 0 to 2^63"));
  }
}

TYPED_TEST(ReachOf, SquaredDistancesAreThoseOfTheDefinition) {
  const auto x = static_cast<BoundOf<TypeParam>>(0.1);
  const auto y = static_cast<BoundOf<TypeParam>>(2.3);
  const std::vector<TypeParam> boxes{
      {{0, 0, 0}, {1, 1, 1}}, {{4, 5, 0}, {5, 6, 1}}, {{1, 0, 0}, {0, 1, 1}}, {{x, y, 0}, {x, y, 9}}};
  const Pairs pairs{{0, 1}, {1, 0}, {0, 0}, {0, 2}, {0, 3}};
  const auto gap = y - 1;
  const auto square = static_cast<double>(rounded(gap, gap, std::multiplies()));
  const ScopedRounding rounding(FE_UPWARD);
  const std::vector<double> squares = squared_distances(boxes, pairs);
  EXPECT_EQ(squares, (std::vector<double>{25, 25, 0, std::numeric_limits<double>::infinity(), square}));
  const std::vector<TypeParam> second{boxes[1]};
  EXPECT_EQ(squared_distances(boxes, second, Pairs{{0, 0}, {1, 0}}), (std::vector<double>{25, 0}));
  EXPECT_THAT(error_of([&] { (void)squared_distances(boxes, second, Pairs{{0, 1}}); }), HasSubstr("(0, 1)"));
}

}  // namespace
}  // namespace broadcl::test
