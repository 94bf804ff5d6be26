#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include <algorithm>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "boxes.hpp"
#include "callers_queue.hpp"
#include "expect_error.hpp"
#include "runs.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

SUITE_ALSO_IN(OnCallersQueue, gpu_profile | rusticl);
SUITE_ALSO_IN(FindersOnCallersQueue, gpu_profile | rusticl);

using test::unit;
using ::testing::HasSubstr;

/// A caller with its own context and queue.
class OnCallersQueue : public testing::Test, protected test::CallersQueue {};

/// The same for each algorithm of a DeviceBroadPhase.
class FindersOnCallersQueue : public testing::TestWithParam<std::string>, protected test::CallersQueue {
 protected:
  DeviceBroadPhase broad_phase_{queue_(), {.algorithm = GetParam()}};
};

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
