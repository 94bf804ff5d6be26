#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numeric>
#include <random>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/error.hpp>

#include "algorithms/algorithm.hpp"
#include "algorithms/engine.hpp"
#include "device_limits.hpp"
#include "each_algorithm.hpp"
#include "environment.hpp"
#include "failing_opencl.hpp"
#include "packed_box.hpp"
#include "scenes/generators.hpp"

/// Searches that begin before the boxes are uploaded, which GPUs with memory of their own do with many boxes.
namespace broadcl::test {
namespace {

using scenes::MovingBoxes;

std::unique_ptr<PairFinder> make_early_tiles(const opencl::Context& context) {
  return make_tiles(context, 1.25, 1);
}

std::unique_ptr<PairFinder> make_early_tiles_in_one_order(const opencl::Context& context) {
  return make_tiles(context, std::numeric_limits<double>::infinity(), 1);
}

/// How a frame was searched.
enum class Searched { early, again, late };

/// Plays frames in which all boxes may move, and compares their changes with those of the oracle.
class EarlySearch : public ::testing::Test {
 protected:
  void start(std::span<const Aabb> boxes, MakePairFinder make = make_early_tiles) {
    algorithm_ = make_device_algorithm({.profile = true}, make);
    oracle_ = make_algorithm({.algorithm = "oracle"});
    for (Algorithm* algorithm : {algorithm_.get(), oracle_.get()}) algorithm->reserve(boxes.size(), true);
    (void)play(boxes);
  }

  /// What differs between frames besides the boxes.
  struct Extras {
    std::vector<std::uint32_t> recycled{};
    std::vector<Filter> filters{};
    bool all_filters = false;
  };

  Searched play(std::span<const Aabb> boxes) { return play(boxes, Extras()); }
  Searched play(std::span<const Aabb> boxes, const Extras& extras) {
    const auto update = [&](Algorithm& algorithm) {
      begin(algorithm, boxes, extras);
      return algorithm.finish();
    };
    const Delta expected = update(*oracle_);
    EXPECT_TRUE(same(update(*algorithm_), expected.added, expected.removed));
    const auto has = [&](std::string_view name) {
      return std::ranges::any_of(algorithm_->profile(),
                                 [&](const Stage& stage) { return stage.name == name; });
    };
    return !has("early") ? Searched::late : has("test") ? Searched::again : Searched::early;
  }

  static void begin(Algorithm& algorithm, std::span<const Aabb> boxes, const Extras& extras) {
    std::vector<std::uint32_t> slots(boxes.size());
    std::iota(slots.begin(), slots.end(), 0);
    std::ranges::copy(boxes, algorithm.boxes().begin());
    algorithm.begin({.slots = boxes.size(),
                     .changed = slots,
                     .all = true,
                     .recycled = extras.recycled,
                     .filters = extras.filters,
                     .all_filters = extras.all_filters});
  }

  /// Moves all boxes once more.
  std::span<const Aabb> next(MovingBoxes& boxes) {
    boxes.advance();
    return boxes.boxes();
  }

  /// Plays frames until one is searched early; at most this many.
  ::testing::AssertionResult becomes_early(MovingBoxes& boxes, std::size_t most) {
    for (std::size_t frame = 0; frame < most; ++frame) {
      if (play(next(boxes)) == Searched::early) return ::testing::AssertionSuccess();
    }
    return ::testing::AssertionFailure() << "no early search in " << most << " frames";
  }

  AlgorithmPointer algorithm_, oracle_;
};
SUITE_ALSO_IN(EarlySearch, gpu_profile | rusticl);

TEST_F(EarlySearch, FindsTheChangesOfBoxesThatMoveSteadily) {
  for (const MovingBoxes::Sizes sizes : {MovingBoxes::Sizes::uniform, MovingBoxes::Sizes::mixed}) {
    MovingBoxes boxes(700, sizes);
    start(boxes.boxes());
    std::size_t early = 0;
    for (std::size_t frame = 0; frame < 60; ++frame) early += play(next(boxes)) == Searched::early ? 1U : 0U;
    EXPECT_GE(early, 30U);
    EXPECT_TRUE(same("all", algorithm_->pairs(), oracle_->pairs()));
  }
}

TEST_F(EarlySearch, EachOfItsCommandsIsTimed) {
  MovingBoxes boxes(700, MovingBoxes::Sizes::uniform);
  start(boxes.boxes());
  const long before = opencl_use().commands_without_event;
  ASSERT_TRUE(becomes_early(boxes, 20));
  std::vector<Aabb> leapt(boxes.boxes().begin(), boxes.boxes().end());
  leapt[3] = leapt[200];
  EXPECT_EQ(play(leapt), Searched::again);
  EXPECT_EQ(opencl_use().commands_without_event, before);
}

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_F(EarlySearch, IsRepeatedIfABoxMovesFartherThanExpected) {
  MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
  start(boxes.boxes());
  std::vector<Aabb> moved;
  for (std::size_t round = 0; round < 3; ++round) {
    ASSERT_TRUE(becomes_early(boxes, 20)) << "round " << round;
    moved.assign(next(boxes).begin(), boxes.boxes().end());
    moved[round] = boxes.boxes()[round + 100];
    EXPECT_EQ(play(moved), Searched::again);
    // Not at once again, since what leapt may leap back.
    EXPECT_EQ(play(next(boxes)), Searched::late);
  }
}

TEST_F(EarlySearch, IsRepeatedIfABoxComesOutOfNothing) {
  MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
  std::vector<Aabb> all(boxes.boxes().begin(), boxes.boxes().end());
  const auto advance = [&](bool with_first) {
    std::ranges::copy(next(boxes), all.begin());
    all[1].lower[0] = -infinity;
    if (!with_first) all[0] = packed_empty();
    return play(all);
  };
  start(all);
  Searched last = Searched::late;
  for (std::size_t frame = 0; frame < 20 && last != Searched::early; ++frame) last = advance(false);
  ASSERT_EQ(last, Searched::early);
  EXPECT_EQ(advance(true), Searched::again);
}

/// Boxes that are all near each other in each frame. Each overlaps a quarter of the others, more and more of
/// them new.
std::vector<Aabb> crowd(std::uint32_t n, std::uint32_t frame) {
  std::vector<Aabb> boxes(n);
  const auto z = static_cast<float>(frame % 2);
  for (std::uint32_t k = 0; k < n; ++k) {
    const std::uint32_t place = (k + frame * (k % 2)) % n / (n / 4);
    const auto x = static_cast<float>(place);
    boxes[k] = {{x, 0, z}, {x + 0.5F, 1, z}};
  }
  return boxes;
}

TEST_F(EarlySearch, MakesRoomForNearPairs) {
  constexpr std::uint32_t n = 600;
  start(crowd(n, 0), make_early_tiles_in_one_order);
  std::size_t again = 0;
  Searched last = Searched::late;
  for (std::uint32_t frame = 1; frame < 40 && last != Searched::early; ++frame) {
    last = play(crowd(n, frame));
    again += last == Searched::again ? 1U : 0U;
  }
  EXPECT_GE(again, 1U);
  EXPECT_EQ(last, Searched::early);
}

/// More near pairs than a work-group tests at a time, with the fewest boxes.
ALSO_IN(oclgrind_gpu_profile);
TEST_F(EarlySearch, SmallCrowdsHaveManyNearPairs) {
  constexpr std::uint32_t n = 60;
  start(crowd(n, 0), make_early_tiles_in_one_order);
  Searched last = Searched::late;
  for (std::uint32_t frame = 1; frame < 10 && last != Searched::early; ++frame) last = play(crowd(n, frame));
  EXPECT_EQ(last, Searched::early);
}

/// Then each margin is as long as the scene, in which all boxes are near each other.
TEST_F(EarlySearch, IsTriedOnceIfABoxLeapsInEachFrame) {
  constexpr std::size_t n = 2000;
  const auto peak = [&](MakePairFinder make) {
    MovingBoxes boxes(n, MovingBoxes::Sizes::uniform);
    std::vector<Aabb> moved(boxes.boxes().begin(), boxes.boxes().end());
    start(moved, make);
    std::size_t again = 0;
    for (std::size_t frame = 0; frame < 60; ++frame) {
      moved.assign(next(boxes).begin(), boxes.boxes().end());
      moved[0] = boxes.boxes()[1 + frame % 10];
      moved[frame % 2] = {{1e3F, 0, 0}, {1e3F, 0, 0}};
      again += play(moved) == Searched::again ? 1U : 0U;
    }
    return std::pair(again, algorithm_->memory().device_peak);
  };
  const auto [again, early] = peak(make_early_tiles);
  const auto [none, late] = peak([](const opencl::Context& context) {
    return make_tiles(context, 1.25, std::numeric_limits<std::size_t>::max());
  });
  EXPECT_EQ(again, 1U);
  EXPECT_EQ(none, 0U);
  constexpr std::size_t near_pairs = (1U << 16U) * sizeof(Pair);
  EXPECT_LE(early, late + 5 * near_pairs / 4 + 30 * n + 4096);
}

TEST_F(EarlySearch, IsRightAlsoIfTheDeviceTakesDenormalNumbersForZeros) {
  const LimitedDevices limited({.has_denormals = false});
  const ScopedVariable cache("BROADCL_CACHE_DIR", "/dev/null");
  for (const float unit : {1e-38F, 1e-39F}) {
    MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
    std::vector<Aabb> small(300);
    const auto advance = [&] {
      std::ranges::transform(next(boxes), small.begin(), [&](Aabb box) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
          box.lower[axis] = (box.lower[axis] - 0.5F) * unit;
          box.upper[axis] = (box.upper[axis] - 0.5F) * unit;
        }
        return box;
      });
      return std::span<const Aabb>(small);
    };
    start(advance());
    std::size_t begun_early = 0;
    for (std::size_t frame = 0; frame < 10; ++frame)
      begun_early += play(advance()) == Searched::late ? 0U : 1U;
    EXPECT_GE(begun_early, 1U);
    EXPECT_FALSE(oracle_->pairs().empty());
    EXPECT_TRUE(same("all", algorithm_->pairs(), oracle_->pairs()));
  }
}

TEST_F(EarlySearch, IsNotDoneIfMoreChangesThanBoxes) {
  MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
  start(boxes.boxes());
  ASSERT_TRUE(becomes_early(boxes, 20));
  EXPECT_EQ(play(next(boxes), {.recycled = {7}}), Searched::late);
  ASSERT_TRUE(becomes_early(boxes, 20));
  std::vector<Filter> filters(300);
  for (Filter& filter : filters) filter.mask = 0;
  EXPECT_EQ(play(next(boxes), {.filters = filters, .all_filters = true}), Searched::late);
  EXPECT_TRUE(algorithm_->pairs().empty());
}

TEST_F(EarlySearch, DoesNotWaitBeforeItsEnd) {
  MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
  start(boxes.boxes(), make_early_tiles_in_one_order);
  ASSERT_TRUE(becomes_early(boxes, 20));
  const long before = opencl_use().blocking_calls;
  begin(*algorithm_, next(boxes), {});
  EXPECT_EQ(opencl_use().blocking_calls, before);
  (void)algorithm_->finish();
}

NOT_IN(rusticl | sanitizers, "fails on purpose, and takes long");
TEST_F(EarlySearch, LosesNothingIfACallFails) {
  MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
  start(boxes.boxes());
  for (const long count : {1L, 1000L}) {
    bool is_reached = true;
    for (long first = 0; is_reached; ++first) {
      ASSERT_TRUE(becomes_early(boxes, 40)) << first << " calls before a failure";
      bool failed = false;
      try {
        const FailingOpenCl fails(first, count);
        begin(*algorithm_, next(boxes), {});
        (void)algorithm_->finish();
        is_reached = FailingOpenCl::calls() > first;
      } catch (const Error&) {
        failed = true;
      }
      if (!failed) {
        begin(*oracle_, boxes.boxes(), {});
        (void)oracle_->finish();
      }
      ASSERT_TRUE(is_reached || first > 20);
      (void)play(next(boxes));
      ASSERT_TRUE(same("all", algorithm_->pairs(), oracle_->pairs())) << first << " calls before a failure";
    }
  }
}

TEST_F(EarlySearch, EndsBeforeItsObjectsDoIfAFrameFails) {
  MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
  start(boxes.boxes());
  ASSERT_TRUE(becomes_early(boxes, 20));
  begin(*algorithm_, next(boxes), {});
  const FailingOpenCl fails(0, 1000);
  EXPECT_THROW((void)algorithm_->finish(), Error);
  algorithm_.reset();
}

/// Whatever happens between two frames.
TEST_F(EarlySearch, FollowsTheOracleThroughRandomFrames) {
  std::size_t early = 0;
  for (const unsigned seed : {1U, 2U, 3U, 4U, 5U}) {
    const bool sets = seed == 5;
    std::mt19937 random(seed);
    const auto below = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
    constexpr std::uint32_t most = 260;
    MovingBoxes scene(most, seed % 2 == 0 ? MovingBoxes::Sizes::uniform : MovingBoxes::Sizes::mixed, seed);
    std::uint32_t n = 200;
    std::vector<Aabb> boxes(scene.boxes().begin(), scene.boxes().begin() + n);
    std::vector<Filter> filters(most);
    if (sets) {
      for (std::size_t k = 0; k < most; ++k) filters[k] = k % 2 == 0 ? Filter::first_set : Filter::second_set;
    }
    std::vector<Pair> exclusions;
    start(boxes);
    for (int frame = 0; frame < 150; ++frame) {
      std::vector<std::uint32_t> slots(n);
      std::iota(slots.begin(), slots.end(), 0U);
      Changes changes{.slots = n, .changed = slots, .all = true, .sets = sets};
      std::vector<std::uint32_t> recycled;
      scene.advance();
      const std::uint32_t event = below(12);
      if (event == 0) changes.slots = n = 200 + below(most - 200);
      boxes.assign(scene.boxes().begin(), scene.boxes().begin() + n);
      if (event == 1) std::erase_if(slots, [&](std::uint32_t slot) { return slot % 7 != 0; });
      changes.all = event != 1;
      changes.changed = slots;
      if (event == 2) recycled = {below(100), 100 + below(100)};
      if (event == 3) {
        for (Filter& filter : filters) filter.world = below(2) == 0 ? 0 : below(3);
      }
      if (event == 4) exclusions = {{below(100), 100 + below(100)}};
      if (event == 5) boxes[below(n)] = boxes[below(n)];
      if (event == 6) boxes[below(n)] = packed_empty();
      if (event == 7) boxes[below(n)].upper[below(3)] = infinity;
      if (event == 8) boxes[below(n)].lower[below(3)] = below(2) == 0 ? 0.0F : -0.0F;
      for (Aabb& box : boxes) box = pack(box);
      changes.recycled = recycled;
      changes.all_filters = event == 3 || event == 4 || (sets && frame == 0);
      const bool has_worlds = std::ranges::any_of(filters, [](const Filter& f) { return f.world != 0; });
      changes.worlds = has_worlds;
      if (has_worlds || sets) changes.filters = std::span(filters).first(n);
      changes.exclusions = exclusions;
      Delta deltas[2];  // NOLINT(modernize-avoid-c-arrays)
      for (std::size_t k = 0; k < 2; ++k) {
        Algorithm& algorithm = k == 0 ? *oracle_ : *algorithm_;
        algorithm.reserve(event == 9 ? most + 40 * static_cast<std::uint32_t>(frame) : n, true);
        algorithm.reserve_exclusions(exclusions.size());
        std::span<Aabb> stored = algorithm.boxes();
        for (std::uint32_t slot = 0; slot < n; ++slot) {
          if (changes.all || slot % 7 == 0) stored[slot] = boxes[slot];
        }
        algorithm.begin(changes);
        deltas[k] = algorithm.finish();
      }
      ASSERT_TRUE(same(deltas[1], deltas[0].added, deltas[0].removed)) << "frame " << frame << " of " << seed;
      for (const Stage& stage : algorithm_->profile()) early += stage.name == "early" ? 1U : 0U;
    }
  }
  EXPECT_GE(early, 60U);
}

}  // namespace
}  // namespace broadcl::test
