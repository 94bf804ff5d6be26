#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/error.hpp>

#include "core/core.hpp"
#include "device_limits.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "engines/engine.hpp"
#include "environment.hpp"
#include "failing_opencl.hpp"
#include "scenes/generators.hpp"
#include "twins.hpp"

/// Searches that begin before the boxes are uploaded, which GPUs with memory of their own do with many boxes.
namespace broadcl::test {
namespace {

using scenes::MovingBoxes;

std::unique_ptr<PairFinder> make_early_tiles(const opencl::Context& context) {
  return make_tiles(context, 3, 1);
}

std::unique_ptr<PairFinder> make_early_tiles_in_one_order(const opencl::Context& context) {
  return make_tiles(context, std::numeric_limits<double>::infinity(), 1);
}

/// How a frame was searched.
enum class Searched { early, again, late };

/// Plays frames in which all boxes may move, and compares their changes with those of the reference.
class EarlySearch : public ::testing::Test {
 protected:
  void start(std::span<const Aabb> boxes, MakePairFinder make = make_early_tiles) {
    twins_.emplace(std::in_place, NoTrouble(), false, make_device_algorithm({.profile = true}, make));
    (void)play(boxes);
  }

  Searched play(std::span<const Aabb> boxes) {
    const long early = launches_of("near_pairs_grow");
    const long searches = launches_of("tiles_search");
    map(boxes);
    EXPECT_TRUE(twins_->agree());
    if (launches_of("near_pairs_grow") == early) return Searched::late;
    return launches_of("tiles_search") > searches + 1 ? Searched::again : Searched::early;
  }

  void map(std::span<const Aabb> boxes) {
    twins_->map(boxes.size(), [&](std::span<Aabb> mapped) { std::ranges::copy(boxes, mapped.begin()); });
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

  std::optional<Twins<Core<Aabb>>> twins_;
};
SUITE_ALSO_IN(EarlySearch, gpu_profile | rusticl);

NOT_IN(sanitizers, "takes long in the reference, which tests each pair");
TEST_F(EarlySearch, FindsTheChangesOfBoxesThatMoveSteadily) {
  for (const MovingBoxes::Sizes sizes : {MovingBoxes::Sizes::uniform, MovingBoxes::Sizes::mixed}) {
    MovingBoxes boxes(700, sizes);
    start(boxes.boxes());
    std::size_t early = 0;
    for (std::size_t frame = 0; frame < 60; ++frame) early += play(next(boxes)) == Searched::early ? 1U : 0U;
    EXPECT_GE(early, 30U);
  }
}

TEST_F(EarlySearch, EachOfItsCommandsIsTimed) {
  MovingBoxes boxes(700, MovingBoxes::Sizes::uniform);
  start(boxes.boxes());
  ASSERT_TRUE(becomes_early(boxes, 20));
  std::vector<Aabb> leapt(boxes.boxes().begin(), boxes.boxes().end());
  leapt[3] = leapt[200];
  for (const std::span<const Aabb> now : {std::span<const Aabb>(leapt), next(boxes)}) {
    map(now);
    const long before = opencl_use().commands_without_event;
    EXPECT_TRUE(twins_->agree(
        [&](const Delta& /*delta*/) { EXPECT_EQ(opencl_use().commands_without_event, before); }));
  }
}

ALSO_IN(oclgrind);
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
    if (!with_first) all[0] = inverted;
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
NOT_IN(all_default | rusticl | sanitizers, "takes long in the reference, which tests each pair");
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
    return std::pair(again, twins_->tested().algorithm().memory().device_peak);
  };
  const auto [again, early] = peak(make_early_tiles);
  const auto [none, late] = peak([](const opencl::Context& context) {
    return make_tiles(context, 3, std::numeric_limits<std::size_t>::max());
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
    EXPECT_FALSE(twins_->pairs().empty());
  }
}

TEST_F(EarlySearch, IsNotDoneIfMoreChangesThanBoxes) {
  MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
  start(boxes.boxes());
  ASSERT_TRUE(becomes_early(boxes, 20));
  twins_->remove(7);
  twins_->add(unit);
  EXPECT_EQ(play(next(boxes)), Searched::late);
  ASSERT_TRUE(becomes_early(boxes, 20));
  for (std::uint32_t id = 0; id < 300; ++id) twins_->set_filter(id, {.mask = 0});
  EXPECT_EQ(play(next(boxes)), Searched::late);
  EXPECT_TRUE(twins_->pairs().empty());
}

TEST_F(EarlySearch, DoesNotWaitBeforeItsEnd) {
  MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
  start(boxes.boxes(), make_early_tiles_in_one_order);
  ASSERT_TRUE(becomes_early(boxes, 20));
  map(next(boxes));
  const long before = opencl_use().blocking_calls;
  twins_->begin();
  EXPECT_EQ(opencl_use().blocking_calls, before);
  EXPECT_TRUE(twins_->agree());
}

NOT_IN(rusticl | sanitizers, "fails on purpose, and takes long");
TEST_F(EarlySearch, LosesNothingIfACallFails) {
  MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
  start(boxes.boxes());
  for (const long count : {1L, 1000L}) {
    bool is_reached = true;
    for (long first = 0; is_reached; ++first) {
      ASSERT_TRUE(becomes_early(boxes, 40)) << first << " calls before a failure";
      map(next(boxes));
      try {
        const FailingOpenCl fails(first, count);
        (void)twins_->tested().finish();
        is_reached = FailingOpenCl::calls() > first;
        twins_->note_update();
      } catch (const Error&) {
      }
      ASSERT_TRUE(is_reached || first > 20);
      (void)play(next(boxes));
      ASSERT_FALSE(HasFailure()) << first << " calls before a failure";
    }
  }
}

TEST_F(EarlySearch, EndsBeforeItsObjectsDoIfAFrameFails) {
  MovingBoxes boxes(300, MovingBoxes::Sizes::uniform);
  start(boxes.boxes());
  ASSERT_TRUE(becomes_early(boxes, 20));
  map(next(boxes));
  twins_->begin();
  const FailingOpenCl fails(0, 1000);
  EXPECT_THROW((void)twins_->tested().finish(), Error);
  twins_.reset();
}

}  // namespace
}  // namespace broadcl::test
