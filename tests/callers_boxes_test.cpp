#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "base/box_parts.hpp"
#include "base/box_replacement.hpp"
#include "base/packed_box.hpp"
#include "core/core.hpp"
#include "each_algorithm.hpp"
#include "engines/hybrid.hpp"
#include "expect_error.hpp"
#include "patience.hpp"
#include "pretender.hpp"
#include "runs.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"

/// update() and begin() with boxes in the caller's memory, many at once. (Random calls have few.)
namespace broadcl::test {
namespace {

using scenes::MovingBoxes;
using ::testing::HasSubstr;

/// More than are copied, and uploaded, at once.
constexpr std::uint32_t many = 40'000;

BroadPhase::Config fast_algorithm(const char* algorithm) {
  return {.algorithm = algorithm};
}

class CallersBoxes : public ::testing::TestWithParam<const char*> {};
SUITE_ALSO_IN(CallersBoxes, gpu_profile);
INSTANTIATE_TEST_SUITE_P(All, CallersBoxes, ::testing::Values("sweep-and-prune", "tiles"),
                         [](const auto& param) { return test_name(param.param); });

TEST_P(CallersBoxes, ManyAreFoundWhetherAllMoveOrFew) {
  BroadPhase broad_phase(fast_algorithm(GetParam()));
  MovingBoxes scene(many, MovingBoxes::Sizes::uniform);
  std::vector<Aabb> boxes(scene.boxes().begin(), scene.boxes().end());
  const auto update = [&](const std::string& what) {
    (void)broad_phase.update(boxes);
    ASSERT_EQ(broad_phase.pairs(), overlapping_pairs(boxes)) << what;
  };
  const auto move = [&](std::size_t every) {
    scene.advance();
    for (std::size_t k = 0; k < many; k += every) boxes[k] = scene.boxes()[k];
  };
  update("first");
  for (const unsigned every : {1U, 1U, 500U, 500U, 500U, 7U, 1U, 1U, 3U, 3U, 2U}) {
    move(every);
    update("one in " + std::to_string(every) + " moved");
  }
  boxes.resize(many - 5000);
  update("some left");
  boxes.resize(many + 10, apart(3));
  update("some came");
}

TEST_P(CallersBoxes, ThatDoNotChangeTakeNoSearch) {
  BroadPhase broad_phase(fast_algorithm(GetParam()));
  const MovingBoxes scene(many, MovingBoxes::Sizes::uniform);
  EXPECT_FALSE(broad_phase.update(scene.boxes()).added.empty());
  for (int frame = 0; frame < 2; ++frame) {  // only after another one is it expected
    EXPECT_TRUE(same(broad_phase.update(scene.boxes()), {}, {}));
  }
  EXPECT_TRUE(broad_phase.profile().empty());
}

TEST_P(CallersBoxes, TheFirstNanAmongManyIsNamedAndNothingChanges) {
  BroadPhase broad_phase(fast_algorithm(GetParam()));
  MovingBoxes scene(many, MovingBoxes::Sizes::uniform);
  for (int frame = 0; frame < 3; ++frame) {
    SCOPED_TRACE(frame);
    std::vector<Aabb> boxes(scene.boxes().begin(), scene.boxes().end());
    (void)broad_phase.update(boxes);
    const Pairs before = broad_phase.pairs();
    std::vector<Aabb> invalid = boxes;
    if (frame < 2) {  // all move, and then one
      scene.advance();
      invalid.assign(scene.boxes().begin(), scene.boxes().end());
    }
    invalid[2] = apart(1);
    for (const std::size_t k : {many - 1, 17'001U, 30'000U}) invalid[k].upper[1] = nan_value;
    for (int time = 0; time < 2; ++time) {
      EXPECT_THAT(error_of([&] { (void)broad_phase.update(invalid); }), HasSubstr("box 17001 has a NaN"));
      EXPECT_THAT(error_of([&] { broad_phase.begin(invalid); }), HasSubstr("box 17001 has a NaN"));
      EXPECT_EQ(broad_phase.pairs(), before);
      for (std::uint32_t k = 0; k < many; ++k) ASSERT_EQ(broad_phase.box(k), boxes[k]);
    }
    EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  }
}

TEST_P(CallersBoxes, MayBeOverwrittenOnceTheUpdateHasBegun) {
  BroadPhase broad_phase(fast_algorithm(GetParam()));
  MovingBoxes scene(many, MovingBoxes::Sizes::uniform);
  for (int frame = 0; frame < 3; ++frame, scene.advance()) {
    std::vector<Aabb> boxes(scene.boxes().begin(), scene.boxes().end());
    const Pairs expected = overlapping_pairs(boxes);
    broad_phase.begin(boxes);
    std::ranges::fill(boxes, unit);
    EXPECT_THAT(error_of([&] { broad_phase.begin(boxes); }), HasSubstr("finish()"));
    (void)broad_phase.finish();
    EXPECT_EQ(broad_phase.pairs(), expected);
  }
}

TEST_P(CallersBoxes, OfAnyLayoutAreTheSame) {
  const MovingBoxes scene(many, MovingBoxes::Sizes::uniform);
  constexpr std::size_t column = many;
  std::vector<double> columns(6 * column);
  std::vector<float> squares;
  for (std::size_t k = 0; k < many; ++k) {
    const Aabb& box = scene.boxes()[k];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      columns[axis * column + k] = static_cast<double>(box.lower[axis]);
      columns[(axis + 3) * column + k] = static_cast<double>(box.upper[axis]);
    }
    if (k < 2000) squares.insert(squares.end(), {box.lower[0], box.lower[1], box.upper[0], box.upper[1]});
  }
  const double* at = columns.data();
  const std::vector<BoxView> views{
      BoxView::arrays<double>({at, at + column, at + 2 * column},
                              {at + 3 * column, at + 4 * column, at + 5 * column}, many),
      BoxView::rectangles(squares.data(), 2000)};
  BroadPhase broad_phase(fast_algorithm(GetParam()));
  for (const BoxView& view : views) {
    for (int frame = 0; frame < 3; ++frame) {
      (void)broad_phase.update(view);
      EXPECT_EQ(broad_phase.pairs(), overlapping_pairs(view));
    }
  }
}

TEST_P(CallersBoxes, ManyMayBeAddedMovedAndRemovedAtOnce) {
  BroadPhase broad_phase(fast_algorithm(GetParam()));
  MovingBoxes scene(many, MovingBoxes::Sizes::uniform);
  std::vector<std::uint32_t> ids = broad_phase.add(scene.boxes());
  ASSERT_EQ(ids.size(), many);
  ASSERT_EQ(ids.back(), many - 1);
  scene.advance();
  const auto expect_found = [&] {
    (void)broad_phase.update();
    EXPECT_EQ(broad_phase.pairs(), overlapping_pairs(scene.boxes()));
  };
  broad_phase.move(ids, scene.boxes());
  expect_found();
  // Not in order, and with an id that is there twice.
  scene.advance();
  std::ranges::reverse(ids);
  ids.insert(ids.begin(), 7);
  std::vector<Aabb> boxes(scene.boxes().begin(), scene.boxes().end());
  boxes.push_back(unit);
  std::ranges::reverse(boxes);
  broad_phase.move(ids, boxes);
  expect_found();
  ids.erase(ids.begin());
  broad_phase.remove(ids);
  EXPECT_EQ(broad_phase.size(), 0U);
  (void)broad_phase.update();
  EXPECT_TRUE(broad_phase.pairs().empty());
}

/// Each part of the boxes begins with an id with which the part before ends.
TEST_P(CallersBoxes, OfIdsThatAreGivenTwiceTheLaterCounts) {
  const auto part = static_cast<std::uint32_t>(boxes_per_part);
  const std::uint32_t n = 40 * part;
  BroadPhase::Config config = fast_algorithm(GetParam());
  config.threads = 2;
  BroadPhase broad_phase(config);
  const std::vector<Aabb> before(n, empty_aabb());
  (void)broad_phase.add(before);
  std::vector<std::uint32_t> ids(n);
  std::vector<Aabb> boxes(n);
  for (std::uint32_t k = 0; k < n; ++k) {
    ids[k] = k - k / part;
    boxes[k] = apart(k);
  }
  broad_phase.move(ids, boxes);
  for (std::uint32_t k = part; k < n; k += part) {
    ASSERT_EQ(ids[k], ids[k - 1]);
    ASSERT_EQ(broad_phase.box(ids[k]), boxes[k]);
  }
}

/// The parts of many boxes are uploaded while others are copied.
TEST(BoxReplacement, PassesOnEachSlotOnce) {
  for (const unsigned n : {0U, 1U, 15U, 16U, 17U, 2047U, 2048U, 2049U, 12'287U, 12'289U, 40'000U, 100'001U}) {
    for (const unsigned threads : {1U, 3U}) {
      const std::vector<Aabb> boxes(n, unit);
      const std::vector<Aabb> before(n);
      std::vector<Aabb> copy(n);
      const BoxView view(boxes);
      const bool samples = threads > 1;
      BoxReplacement<Aabb> replacement(view, before, copy, true, samples, threads);
      std::size_t next = 0;
      do {
        const std::size_t begin = std::exchange(next, replacement.next());
        ASSERT_TRUE(begin < next || next == n);
        ASSERT_TRUE(
            std::all_of(copy.data() + begin, copy.data() + next, [](const Aabb& b) { return b == unit; }));
      } while (next < n);
      EXPECT_EQ(copy, boxes);
      EXPECT_NEAR(static_cast<double>(replacement.count()), n, samples ? 256 : 0);
    }
  }
}

TEST(BoxReplacement, TellsWhichChange) {
  constexpr std::uint32_t n = 40'000;
  std::vector<Aabb> boxes(n, unit);
  const std::vector<Aabb> before = boxes;
  const std::vector<std::uint32_t> expected{0, 15, 16, 2047, 2048, 17'003, n - 1};
  for (const std::uint32_t slot : expected) boxes[slot] = apart(slot + 1);
  boxes[15] = empty_aabb();
  const BoxView view(boxes);
  std::vector<Aabb> copy(n);
  for (const std::span<Aabb> to : {std::span(copy), std::span<Aabb>()}) {  // or they are only compared
    BoxReplacement<Aabb> replacement(view, before, to, false, false, 2);
    replacement.finish();
    EXPECT_EQ(replacement.count(), expected.size());
    EXPECT_FALSE(replacement.are_many());
    EXPECT_TRUE(replacement.any_empty());
    std::vector<std::uint32_t> changed;
    replacement.for_each_changed([&](std::uint32_t slot) { changed.push_back(slot); });
    EXPECT_EQ(changed, expected);
  }
}

/// A NaN is named by what copies them, which looks at all boxes.
TEST(BoxReplacement, ComparesNoMoreThanItNeedsTo) {
  constexpr std::uint32_t n = 40'000;
  std::vector<Aabb> boxes(n, unit);
  const std::vector<Aabb> before(n);
  boxes[0].upper[1] = boxes[n - 1].upper[1] = nan_value;
  const BoxView view(boxes);
  BoxReplacement<Aabb> comparison(view, before, {}, false, false, 1);
  EXPECT_NO_THROW(comparison.finish());
  EXPECT_TRUE(comparison.are_many());
  EXPECT_LT(comparison.count(), n / 2);
  std::vector<Aabb> copy(n);
  BoxReplacement<Aabb> replacement(view, before, copy, false, false, 1);
  EXPECT_THROW(replacement.finish(), InvalidBox);
}

/// `auto` leaves a device that fails, with all that there was before.
TEST(HybridFailure, OfAnUpdateWithTheCallersBoxesKeepsTheOldOnes) {
  struct Case {
    bool many_move;
    std::size_t n;  // boxes of the update that fails
  };
  for (const auto& [many_move, n] : {Case{true, 8}, Case{true, 6}, Case{false, 8}, Case{false, 6}}) {
    for (const char* function : {"begin", "finish"}) {
      SCOPED_TRACE(function);
      Pretender::Orders orders{.expected_seconds = 0};
      Core<Aabb> core(make_hybrid(
          make_algorithm({.algorithm = "sweep-and-prune"}),
          [&orders] { return std::make_unique<Pretender>(orders); }, 0));
      std::vector<Aabb> boxes{unit, unit, apart(1), apart(2), apart(3), apart(4), apart(5), apart(6)};
      const auto start = std::chrono::steady_clock::now();
      for (std::size_t turn = 0; core.algorithm().device() == nullptr; ++turn) {
        ASSERT_LT(std::chrono::steady_clock::now() - start, patience);
        boxes[7] = apart(6 + turn % 2);
        (void)core.update(boxes);
      }
      if (many_move) {
        for (std::size_t k = 2; k < 8; ++k) boxes[k] = apart(10 + k);
      }
      (void)core.update(boxes);  // in which none move otherwise
      const Pairs before = core.pairs();
      std::vector<Aabb> moved = boxes;
      moved[1] = apart(20);
      moved.resize(n);
      orders.fails = function;
      EXPECT_EQ(error_of([&] { (void)core.update(moved); }), "the device failed");
      EXPECT_EQ(core.algorithm().device(), nullptr);
      EXPECT_EQ(core.pairs(), before);
      ASSERT_EQ(core.size(), 8U);
      for (std::uint32_t k = 0; k < 8; ++k) EXPECT_EQ(core.box(k), boxes[k]);
      EXPECT_TRUE(same(core.finish(), {}, {}));
      EXPECT_TRUE(same(core.update(moved), {}, Pairs{{0, 1}}));
    }
  }
}

/// What the caller wrote to a map() counts again if an update with other boxes fails.
TEST(CallersBoxesFailure, LeavesAMapAsItWas) {
  for (const char* function : {"begin", "finish"}) {
    Pretender::Orders orders;
    Core<Aabb> core(std::make_unique<Pretender>(orders, "sweep-and-prune"));
    const std::vector<Aabb> boxes{unit, unit, apart(1), apart(2)};
    for (int frame = 0; frame < 3; ++frame) (void)core.update(boxes);
    core.map(4)[3].lower[0] = nan_value;
    orders.fails = function;
    EXPECT_EQ(error_of([&] { (void)core.update(boxes); }), "the device failed");
    orders.fails.clear();
    EXPECT_THAT(error_of([&] { (void)core.finish(); }), ::testing::HasSubstr("box 3 has a NaN")) << function;
  }
}

}  // namespace
}  // namespace broadcl::test
