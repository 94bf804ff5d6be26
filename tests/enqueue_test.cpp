#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "device_twins.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "failing_opencl.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"

/// Updates that the caller does not wait for.
namespace broadcl::test {
namespace {

using scenes::MovingBoxes;
using ::testing::HasSubstr;

/// Buffers for the changes of an update.
struct Lists {
  Lists(const CallersQueue& queue, std::size_t capacity)
      : added(queue.buffer_of(Pairs(capacity))),
        removed(queue.buffer_of(Pairs(capacity))),
        counts(queue.buffer_of(std::vector<std::uint32_t>(4, 77))),
        arguments{.added = added(), .removed = removed(), .capacity = capacity, .counts = counts()} {}

  cl::Buffer added, removed, counts;
  DeviceBroadPhase::ChangeBuffers arguments;
};

/// Boxes in motion.
class Scene {
 public:
  explicit Scene(std::uint32_t n) : motion_(n, MovingBoxes::Sizes::mixed) {}

  /// The next frame, which has the first n boxes.
  DeviceFrame advance(std::size_t n, bool with_filters = false) {
    motion_.advance();
    DeviceFrame frame{
        .boxes = {motion_.boxes().begin(), motion_.boxes().begin() + static_cast<std::ptrdiff_t>(n)},
        .worlds = with_filters};
    for (std::uint32_t k = 0; with_filters && k < n; ++k) frame.filters.push_back({.world = k % 3});
    return frame;
  }

 private:
  MovingBoxes motion_;
};

class Enqueue : public ::testing::TestWithParam<std::string> {
 protected:
  /// Moves boxes over some frames, and waits for every tenth only.
  /// @param capacity Of the lists of changes.
  void follow(std::uint32_t n, std::size_t capacity, int frames = 25) {
    Scene scene(n);
    DeviceTwins twins(queue_, {.algorithm = GetParam()});
    twins.reserve(n, std::size_t{n} * 40);
    const std::array counts{n, n, n, n / 2, n, 1U, 0U, n, n, n - 1};
    for (int frame = 0; frame < frames; ++frame) {
      const DeviceFrame next =
          scene.advance(counts.at(static_cast<std::size_t>(frame) % counts.size()), frame > frames / 2);
      if (frame % 10 == 9) {
        ASSERT_TRUE(twins.update(next)) << "frame " << frame;
      } else {
        twins.enqueue(next, capacity);
        ASSERT_FALSE(twins.is_halted());
        ASSERT_TRUE(twins.agree()) << "frame " << frame;
      }
    }
    ASSERT_TRUE(twins.agree_on_pairs());
  }

  const CallersQueue queue_;
  DeviceBroadPhase broad_phase_{queue_(), {.algorithm = GetParam()}};
};

SUITE_ALSO_IN(Enqueue, gpu_profile | rusticl);

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_P(Enqueue, SmallFramesHaveTheirChanges) {
  follow(50, 1500, 8);
}

TEST_P(Enqueue, FramesHaveTheirChanges) {
  follow(400, 4000);
}

/// Lists long enough to be ordered by buckets.
TEST_P(Enqueue, FramesWithLongListsHaveTheirChanges) {
  follow(600, 20'000);
}

/// More pairs than fit, until reserve() adds capacity.
TEST_P(Enqueue, PairsThatDoNotFitWaitForRoom) {
  constexpr std::uint32_t n = 300;
  constexpr std::size_t all = n * (n - 1) / 2;
  const cl::Buffer apart_buffer = [&] {
    std::vector<Aabb> boxes;
    for (std::uint32_t k = 0; k < n; ++k) boxes.push_back(apart(k));
    return queue_.buffer_of(boxes);
  }();
  const cl::Buffer together = queue_.buffer_of(std::vector<Aabb>(n, unit));
  const Lists lists(queue_, all);
  broad_phase_.reserve(n, 100);
  broad_phase_.enqueue({.buffer = apart_buffer(), .count = n}, lists.arguments);
  EXPECT_EQ(queue_.read_counts(lists.counts), (std::array<std::uint32_t, 4>{0, 0, 0, 0}));
  for (int k = 0; k < 3; ++k) {
    broad_phase_.enqueue({.buffer = together(), .count = n}, lists.arguments);
    EXPECT_EQ(queue_.read_counts(lists.counts), (std::array<std::uint32_t, 4>{0, 0, 0, 1}));
  }
  EXPECT_EQ(broad_phase_.pairs().count, 0U);
  broad_phase_.reserve(n, all);
  broad_phase_.enqueue({.buffer = together(), .count = n}, lists.arguments);
  EXPECT_EQ(queue_.read_counts(lists.counts), (std::array<std::uint32_t, 4>{all, 0, all, 0}));
  EXPECT_TRUE(same("added", queue_.read({lists.added(), all}), all_pairs(n)));
  const auto result = broad_phase_.update({.buffer = apart_buffer(), .count = n});
  EXPECT_EQ(result.removed.count, all);
  EXPECT_EQ(result.incomplete, 3U);
}

/// With more boxes and far more pairs than reserve() was called for; afterwards the lists differ in size.
TEST_P(Enqueue, WaitingUpdatesInBetweenMayBeLarger) {
  constexpr std::uint32_t few = 200;
  constexpr std::uint32_t many = 300;
  const cl::Buffer together = queue_.buffer_of(std::vector<Aabb>(many, unit));
  const Lists lists(queue_, many * (many - 1) / 2);
  broad_phase_.reserve(few, 100);
  for (const std::size_t waiting : {many, 10U, many, few + 50U}) {
    const std::size_t all = waiting * (waiting - 1) / 2;
    ASSERT_EQ(broad_phase_.update({.buffer = together(), .count = waiting}).pair_count, all);
    std::size_t known = all;
    for (const std::uint32_t count : {few, 0U, few - 1U, few}) {
      const auto found = std::uint32_t{count * (count > 0 ? count - 1 : 0) / 2};
      broad_phase_.enqueue({.buffer = together(), .count = count}, lists.arguments);
      const auto words = queue_.read_counts(lists.counts);
      ASSERT_EQ(words[0], found > known ? found - known : 0U) << waiting << ", " << count;
      ASSERT_EQ(words[1], found < known ? known - found : 0U) << waiting << ", " << count;
      ASSERT_EQ(words[2], found);
      ASSERT_EQ(words[3], 0U);
      known = found;
    }
    ASSERT_TRUE(same("all", queue_.read(broad_phase_.pairs()), all_pairs(few)));
  }
}

/// More pairs may end than reserve() was called for.
TEST_P(Enqueue, PairsThatWaitingUpdatesAddedMayEnd) {
  constexpr std::uint32_t n = 6000;
  constexpr std::uint32_t more = 400;
  constexpr std::uint32_t updates = 12;
  const auto boxes_of = [&](std::uint32_t touching) {
    std::vector<Aabb> boxes;
    for (std::uint32_t k = 0; k < n; ++k) boxes.push_back(apart(k < touching ? k / 2 : k));
    return queue_.buffer_of(boxes);
  };
  for (std::uint32_t k = 1; k <= updates; ++k) {
    const cl::Buffer boxes = boxes_of(k * more);
    ASSERT_EQ(broad_phase_.update({.buffer = boxes(), .count = n}).added.count, more / 2);
  }
  broad_phase_.reserve(n, 100);
  const Lists lists(queue_, n);
  const cl::Buffer boxes = boxes_of(0);
  broad_phase_.enqueue({.buffer = boxes(), .count = n}, lists.arguments);
  EXPECT_EQ(queue_.read_counts(lists.counts), (std::array<std::uint32_t, 4>{0, updates * more / 2, 0, 0}));
}

/// If a call (every sixth in turn) fails while a waiting update replaces lists by larger ones.
TEST(EnqueueBruteForce, KeepsWhatWasReservedAfterAFailedUpdate) {
  const CallersQueue queue;
  constexpr std::uint32_t reserved = 250;
  constexpr std::uint32_t larger = 400;
  const cl::Buffer together = queue.buffer_of(std::vector<Aabb>(larger, unit));
  const Lists lists(queue, reserved * (reserved - 1) / 2);
  bool has_failed = true;
  long failures = 0;
  for (long first = 0; has_failed; first += 6) {
    SCOPED_TRACE("call " + std::to_string(first));
    DeviceBroadPhase broad_phase(queue(), {.algorithm = "brute-force"});
    broad_phase.reserve(reserved, lists.arguments.capacity);
    broad_phase.enqueue({.buffer = together(), .count = 2}, lists.arguments);
    try {
      const FailingOpenCl one_fails(first, 1);
      (void)broad_phase.update({.buffer = together(), .count = larger});
      has_failed = FailingOpenCl::calls() > first;
    } catch (const Error&) {
    }
    if (!has_failed) break;
    ++failures;
    broad_phase.enqueue({.buffer = together(), .count = 3}, lists.arguments);
    broad_phase.enqueue({.buffer = together(), .count = reserved}, lists.arguments);
    const std::uint32_t all = reserved * (reserved - 1) / 2;
    ASSERT_EQ(queue.read_counts(lists.counts), (std::array<std::uint32_t, 4>{all - 3, 0, all, 0}));
  }
  EXPECT_GT(failures, 4);
}

/// Tiles may have been sorted in a halted update, by boxes that never took effect.
TEST(EnqueueTiles, AreSortedAgainAfterIncompleteUpdates) {
  constexpr std::uint32_t n = 500;
  const CallersQueue queue;
  DeviceTwins twins(queue, {.algorithm = "tiles"});
  Scene scene(n);
  const auto sorts_of_update = [&] {
    const long before = launches_of("tiles_keys");
    EXPECT_TRUE(twins.update(scene.advance(n)));
    return launches_of("tiles_keys") - before;
  };
  EXPECT_EQ(sorts_of_update(), 1);
  EXPECT_EQ(sorts_of_update(), 0);
  twins.reserve(n, 20'000);
  twins.enqueue(scene.advance(n), 1);
  EXPECT_EQ(sorts_of_update(), 1);
  EXPECT_EQ(sorts_of_update(), 0);
}

/// No id has so many changes that an enqueued update is incomplete, but neighbouring ids together do.
NOT_IN(sanitizers, "takes long");
TEST(EnqueueTiles, NeighbouringIdsMayHaveManyChanges) {
  constexpr std::uint32_t n = 1U << 18U;
  constexpr std::uint32_t small = 600;
  constexpr std::uint32_t large = 8;
  std::vector<Aabb> boxes(n);
  for (std::uint32_t id = 0; id < n; ++id) boxes[id] = apart(id);
  const CallersQueue queue;
  DeviceBroadPhase broad_phase(queue(), {.algorithm = "tiles"});
  broad_phase.reserve(n, n);
  const cl::Buffer before = queue.buffer_of(boxes);
  EXPECT_EQ(broad_phase.update({.buffer = before(), .count = n}).pair_count, 0U);

  Pairs expected;
  for (std::uint32_t b = 640; b < 640 + large; ++b) {
    boxes[b] = {{0, 0, 0}, {2.0F * small - 1, 1, 1}};
    for (std::uint32_t a = 0; a < small; ++a) expected.push_back({a, b});
    for (std::uint32_t a = 640; a < b; ++a) expected.push_back({a, b});
  }
  const cl::Buffer after = queue.buffer_of(boxes);
  const Lists lists(queue, 8200);
  broad_phase.enqueue({.buffer = after(), .count = n}, lists.arguments);
  const auto counts = queue.read_counts(lists.counts);
  EXPECT_EQ(counts[3], 0U);
  ASSERT_EQ(counts[0], expected.size());
  Pairs added = queue.read({.buffer = lists.added(), .count = expected.size()});
  EXPECT_EQ(added, expected);
}

TEST_P(Enqueue, DoesNotBlock) {
  Scene scene(500);
  broad_phase_.reserve(500, 20'000, true);
  const Lists lists(queue_, 5000);
  std::vector<cl::Buffer> frames;
  frames.reserve(12);
  for (int frame = 0; frame < 12; ++frame) frames.push_back(queue_.buffer_of(scene.advance(500).boxes));
  const cl::Buffer filters = queue_.buffer_of(scene.advance(500, true).filters);
  const long start = opencl_use().blocking_calls;
  for (std::size_t frame = 0; frame < frames.size(); ++frame) {
    broad_phase_.enqueue({.buffer = frames[frame](),
                          .count = 500,
                          .filters = frame > 6 ? filters() : nullptr,
                          .worlds = frame > 6},
                         lists.arguments);
  }
  EXPECT_EQ(opencl_use().blocking_calls, start);
  EXPECT_LT(broad_phase_.profile().size(), 10U);  // those of one update
  EXPECT_EQ(queue_.read_counts(lists.counts)[3], 0U);
}

TEST_P(Enqueue, BadInputIsNamed) {
  const cl::Buffer ten = queue_.buffer_of(std::vector<Aabb>(10, unit));
  const cl::Buffer filters = queue_.buffer_of(std::vector<Filter>(10));
  const DeviceBroadPhase::Boxes boxes{.buffer = ten(), .count = 10};
  const DeviceBroadPhase::Boxes filtered{.buffer = ten(), .count = 10, .filters = filters()};
  const Lists lists(queue_, 45);
  const auto error = [&](const DeviceBroadPhase::Boxes& given, DeviceBroadPhase::ChangeBuffers changes) {
    return error_of([&] { broad_phase_.enqueue(given, changes); });
  };
  EXPECT_THAT(error(boxes, lists.arguments), HasSubstr("10 boxes, but reserve() was called for 0"));
  broad_phase_.reserve(10, 45);
  EXPECT_NE(error_of([&] { broad_phase_.reserve(10, std::size_t{1} << 40U); }), "");
  EXPECT_THAT(error(boxes, lists.arguments), HasSubstr("reserve() was called for 0"));
  broad_phase_.reserve(10, 45);
  EXPECT_THAT(error(filtered, lists.arguments), HasSubstr("filters, but reserve() was called without"));
  const long start = opencl_use().blocking_calls;
  auto bad = lists.arguments;
  bad.capacity = 46;
  EXPECT_THAT(error(boxes, bad), HasSubstr("added pairs has 360 bytes, too few for 46"));
  bad.capacity = 0;
  EXPECT_THAT(error(boxes, bad), HasSubstr("capacity for changes is 0"));
  bad = lists.arguments;
  bad.counts = nullptr;
  EXPECT_THAT(error(boxes, bad), HasSubstr("counts is null"));
  EXPECT_NE(error_of([&] { broad_phase_.begin({.buffer = nullptr, .count = 10}); }), "");
  EXPECT_EQ(opencl_use().blocking_calls, start);
  broad_phase_.begin(boxes);
  EXPECT_THAT(error(boxes, lists.arguments), HasSubstr("call finish() first"));
  EXPECT_THAT(error_of([&] { broad_phase_.reserve(1, 1); }), HasSubstr("call finish() first"));
  EXPECT_EQ(broad_phase_.finish().incomplete, 0U);
}

INSTANTIATE_TEST_SUITE_P(Finders, Enqueue, ::testing::Values("auto", "brute-force", "tiles"),
                         named_by_parameter);

}  // namespace
}  // namespace broadcl::test
