#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include <algorithm>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "base/pair_lists.hpp"
#include "boxes.hpp"
#include "device_life.hpp"
#include "expect_error.hpp"
#include "runs.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

SUITE_ALSO_IN(OnCallersQueue, gpu_profile | rusticl);
SUITE_ALSO_IN(FindersOnCallersQueue, gpu_profile | rusticl);

using test::nan_value;
using test::unit;
using ::testing::HasSubstr;

/// A caller with its own context and queue.
class OnCallersQueue : public testing::Test, protected test::CallersQueue {};

/// The same for each algorithm of a DeviceBroadPhase.
class FindersOnCallersQueue : public testing::TestWithParam<std::string>, protected test::CallersQueue {
 protected:
  DeviceBroadPhase broad_phase_{queue_(), {.algorithm = GetParam()}};
};

/// The changes must be those of a BroadPhase with the same boxes, over frames in which all boxes move and
/// their number changes.
ALSO_IN(oclgrind);
TEST_P(FindersOnCallersQueue, SmallFramesOfMotionHaveTheChangesOfTheOracle) {
  BroadPhase oracle({.algorithm = "oracle"});
  scenes::MovingBoxes boxes(300, scenes::MovingBoxes::Sizes::mixed);
  for (const std::size_t count : {300U, 300U, 300U, 120U, 1U, 0U, 256U, 300U}) {
    boxes.advance();
    const std::vector<Aabb> now(boxes.boxes().begin(),
                                boxes.boxes().begin() + static_cast<std::ptrdiff_t>(count));
    const cl::Buffer buffer = buffer_of(now);
    const auto result = broad_phase_.update({.buffer = buffer(), .count = count});
    const std::span<Aabb> mapped = oracle.map(count);
    std::copy(now.begin(), now.end(), mapped.begin());
    const Delta expected = oracle.update();
    EXPECT_EQ(read(result.added), std::vector<Pair>(expected.added.begin(), expected.added.end()));
    EXPECT_EQ(read(result.removed), std::vector<Pair>(expected.removed.begin(), expected.removed.end()));
    EXPECT_EQ(result.pair_count, oracle.pairs().size());
    EXPECT_EQ(read(broad_phase_.pairs()), oracle.pairs());
    EXPECT_EQ(result.invalid_boxes, 0U);
  }
}

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_P(FindersOnCallersQueue, SmallOffsetStrideAndFiltersAreHeeded) {
  // A header of one float, then ten floats per box; the last four of them are the caller's.
  const scenes::MovingBoxes boxes(200, scenes::MovingBoxes::Sizes::mixed);
  std::vector<float> floats{nan_value};
  std::vector<Filter> filters;
  for (std::uint32_t k = 0; k < 200; ++k) {
    const Aabb& box = boxes.boxes()[k];
    floats.insert(floats.end(), box.lower.begin(), box.lower.end());
    floats.insert(floats.end(), box.upper.begin(), box.upper.end());
    floats.insert(floats.end(), 4, nan_value);
    filters.push_back({.group = 1U << (k % 3), .mask = k % 5 == 0 ? 3U : 7U, .body = k / 4, .world = k % 2});
  }
  const cl::Buffer buffer = buffer_of(floats);
  const cl::Buffer filter_buffer = buffer_of(filters);
  for (const bool worlds : {true, false}) {
    std::vector<Pair> expected;
    for (std::uint32_t b = 0; b < 200; ++b) {
      for (std::uint32_t a = 0; a < b; ++a) {
        if (overlaps(boxes.boxes()[a], boxes.boxes()[b]) && may_pair(filters[a], filters[b]))
          expected.push_back({a, b});
      }
    }
    ASSERT_GT(expected.size(), 10U);
    broad_phase_.update({.buffer = buffer(),
                         .count = 200,
                         .offset = 4,
                         .stride = 40,
                         .filters = filter_buffer(),
                         .worlds = worlds});
    EXPECT_EQ(read(broad_phase_.pairs()), expected) << worlds;
  }
}

ALSO_IN(oclgrind);
TEST_P(FindersOnCallersQueue, SmallExclusionsAreNotReported) {
  constexpr std::uint32_t n = 150;
  BroadPhase oracle({.algorithm = "oracle"});
  scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::mixed);
  std::vector<Pair> exclusions;
  std::vector<Pair> known;
  const auto expect_changes = [&](const std::string& what) {
    std::ranges::copy(boxes.boxes(), oracle.map(n).begin());
    (void)oracle.update();
    const std::vector<Pair> now = difference(oracle.pairs(), exclusions);
    const cl::Buffer buffer = buffer_of(std::vector<Aabb>(boxes.boxes().begin(), boxes.boxes().end()));
    const auto result = broad_phase_.update({.buffer = buffer(), .count = n});
    EXPECT_EQ(read(result.added), difference(now, known)) << what;
    EXPECT_EQ(read(result.removed), difference(known, now)) << what;
    EXPECT_EQ(read(broad_phase_.pairs()), now) << what;
    known = now;
  };
  expect_changes("none are excluded");
  ASSERT_GT(known.size(), 30U);
  for (std::size_t k = 0; k < known.size(); k += 2) exclusions.push_back(known[k]);
  broad_phase_.set_exclusions(exclusions);
  expect_changes("some that are known");
  boxes.advance();
  expect_changes("while all move");
  exclusions.clear();
  for (std::uint32_t b = 1; b < n; ++b) exclusions.push_back({b / 2, b});
  std::vector<Pair> reversed;
  for (const Pair& pair : exclusions) reversed.insert(reversed.begin(), {pair.b, pair.a});
  broad_phase_.set_exclusions(reversed);
  boxes.advance();
  expect_changes("others");
  EXPECT_THAT(test::error_of([&] {
                broad_phase_.set_exclusions(std::vector<Pair>{{3, 3}});
              }),
              HasSubstr("an exclusion is of 3 and itself"));
  boxes.advance();
  expect_changes("those before the error");
  broad_phase_.set_exclusions({});
  exclusions.clear();
  expect_changes("none again");
}

ALSO_IN(oclgrind);
TEST_P(FindersOnCallersQueue, SmallExclusionsOfTwoSetsCountTheSecondBehindTheFirst) {
  const cl::Buffer first = buffer_of(std::vector<Aabb>(3, Aabb{{0, 0, 0}, {1, 1, 1}}));
  const cl::Buffer second = buffer_of(std::vector<Aabb>(2, Aabb{{0, 0, 0}, {1, 1, 1}}));
  broad_phase_.set_exclusions(std::vector<Pair>{{4, 0}, {1, 3}});
  const auto result =
      broad_phase_.update({.buffer = first(), .count = 3, .second = {.buffer = second(), .count = 2}});
  EXPECT_EQ(read(result.added), (std::vector<Pair>{{0, 0}, {2, 0}, {1, 1}, {2, 1}}));
}

ALSO_IN(oclgrind);
TEST_P(FindersOnCallersQueue, SmallInvalidAndEmptyBoxesPairWithNothing) {
  std::vector<Aabb> boxes(40, unit);
  boxes[7].upper[2] = nan_value;
  boxes[5].lower[0] = nan_value;
  boxes[9] = {{0.5F, 0.75F, 0.5F}, {0.5F, 0.25F, 0.5F}};
  const cl::Buffer buffer = buffer_of(boxes);
  const auto result = broad_phase_.update({.buffer = buffer(), .count = boxes.size()});
  EXPECT_EQ(result.invalid_boxes, 2U);
  EXPECT_EQ(result.first_invalid, 5U);
  EXPECT_EQ(result.pair_count, 37U * 36 / 2);
}

TEST_P(FindersOnCallersQueue, MorePairsThanAnyGuessAreAllFoundAndInOrder) {
  constexpr std::uint32_t n = 700;
  const std::vector<Aabb> boxes(n, Aabb{{0, 0, 0}, {1, 1, 1}});
  const cl::Buffer buffer = buffer_of(boxes);
  const std::vector<Pair> added = read(broad_phase_.update({.buffer = buffer(), .count = n}).added);
  ASSERT_EQ(added.size(), n * (n - 1) / 2);
  EXPECT_TRUE(std::is_sorted(added.begin(), added.end()));
  EXPECT_EQ(std::adjacent_find(added.begin(), added.end()), added.end());
  EXPECT_EQ(broad_phase_.update({.buffer = buffer(), .count = n}).added.count, 0U);
}

/// Even if the lists are too small at first, so that the frame is searched again.
TEST_P(FindersOnCallersQueue, LaterCommandsMayOverwriteTheBoxesOfAnUpdateThatWasBegun) {
  constexpr std::uint32_t n = 700;
  const cl::Buffer buffer = buffer_of(std::vector<Aabb>(n, unit));
  std::vector<Aabb> apart(n, unit);
  for (std::uint32_t k = 0; k < n; ++k) apart[k].lower[0] = apart[k].upper[0] = static_cast<float>(2 * k);
  broad_phase_.begin({.buffer = buffer(), .count = n});
  queue_.enqueueWriteBuffer(buffer, CL_TRUE, 0, n * sizeof(Aabb), apart.data());
  EXPECT_EQ(broad_phase_.finish().added.count, n * (n - 1) / 2);
  EXPECT_EQ(broad_phase_.update({.buffer = buffer(), .count = n}).removed.count, n * (n - 1) / 2);
}

INSTANTIATE_TEST_SUITE_P(All, FindersOnCallersQueue, ::testing::Values("auto", "brute-force", "tiles"),
                         test::named_by_parameter);

/// Enough boxes that they are gathered before they are put into tiles.
NOT_IN(gpu_profile | rusticl | sanitizers, "takes long");
TEST_F(OnCallersQueue, ManyBoxesHaveTheChangesOfBoxesFromTheHost) {
  constexpr std::uint32_t n = 140'000;
  DeviceBroadPhase broad_phase(queue_(), {.algorithm = "tiles"});
  BroadPhase from_host({.algorithm = "tiles"});
  scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::uniform);
  for (int frame = 0; frame < 3; ++frame) {
    boxes.advance();
    const std::vector<Aabb> now(boxes.boxes().begin(), boxes.boxes().end());
    const cl::Buffer buffer = buffer_of(now);
    const auto result = broad_phase.update({.buffer = buffer(), .count = n});
    std::ranges::copy(now, from_host.map(n).begin());
    const Delta expected = from_host.update();
    ASSERT_GT(expected.added.size(), 1000U);
    EXPECT_TRUE(test::same("added", read(result.added), expected.added)) << frame;
    EXPECT_TRUE(test::same("removed", read(result.removed), expected.removed)) << frame;
  }
}

TEST_F(OnCallersQueue, BeginLeavesTheThreadFreeUntilFinish) {
  const std::vector<Aabb> boxes(10, Aabb{{0, 0, 0}, {1, 1, 1}});
  const cl::Buffer buffer = buffer_of(boxes);
  DeviceBroadPhase broad_phase(queue_());
  EXPECT_THAT(test::error_of([&] { broad_phase.finish(); }), HasSubstr("without begin()"));
  broad_phase.begin({.buffer = buffer(), .count = 10});
  EXPECT_THAT(test::error_of([&] { broad_phase.begin({.buffer = buffer(), .count = 10}); }),
              HasSubstr("call finish()"));
  EXPECT_THAT(test::error_of([&] { broad_phase.pairs(); }), HasSubstr("call finish()"));
  EXPECT_EQ(broad_phase.finish().added.count, 45U);
}

NOT_IN(rusticl, "has no out-of-order queues");
TEST_F(OnCallersQueue, BadQueuesAndAlgorithmsAreNamed) {
  EXPECT_THAT(test::error_of([&] { DeviceBroadPhase refused(nullptr); }), HasSubstr("null"));
  EXPECT_THAT(test::error_of([&] { DeviceBroadPhase refused(queue_(), {.algorithm = "gpu-bf"}); }),
              HasSubstr("use one of: auto, brute-force"));
  cl::CommandQueue disordered;
  try {
    disordered = cl::CommandQueue(context_, device_, CL_QUEUE_OUT_OF_ORDER_EXEC_MODE_ENABLE);
  } catch (const cl::Error&) {
    GTEST_SKIP() << "the device has no out-of-order queues";
  }
  EXPECT_THAT(test::error_of([&] { DeviceBroadPhase refused(disordered()); }), HasSubstr("in order"));
}

}  // namespace
}  // namespace broadcl
