#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "device_life.hpp"
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

/// The same boxes on the host for an oracle, and on the device.
class Scene {
 public:
  Scene(const CallersQueue& queue, std::uint32_t n) : queue_(queue), motion_(n, MovingBoxes::Sizes::mixed) {}

  /// Advances to the next frame, which has the first n boxes.
  DeviceBroadPhase::Boxes advance(std::size_t n, bool with_filters = false) {
    motion_.advance();
    boxes_.assign(motion_.boxes().begin(), motion_.boxes().begin() + static_cast<std::ptrdiff_t>(n));
    filters_.assign(n, Filter());
    for (std::size_t k = 0; with_filters && k < n; ++k) filters_[k].world = static_cast<std::uint32_t>(k % 3);
    buffers_.push_back(queue_.buffer_of(boxes_));
    const auto boxes = buffers_.back()();
    buffers_.push_back(queue_.buffer_of(filters_));
    return {.buffer = boxes,
            .count = n,
            .filters = with_filters ? buffers_.back()() : nullptr,
            .worlds = with_filters};
  }

  /// The oracle's changes since its last update.
  Delta oracle() {
    const std::span<Aabb> mapped = oracle_.map(boxes_.size());
    std::copy(boxes_.begin(), boxes_.end(), mapped.begin());
    for (std::uint32_t k = 0; k < boxes_.size(); ++k) oracle_.set_filter(k, filters_[k]);
    return oracle_.update();
  }
  [[nodiscard]] Pairs oracle_pairs() const { return oracle_.pairs(); }

 private:
  const CallersQueue& queue_;
  MovingBoxes motion_;
  std::vector<Aabb> boxes_;
  std::vector<Filter> filters_;
  std::vector<cl::Buffer> buffers_;  // enqueued commands read them
  BroadPhase oracle_{{.algorithm = "oracle"}};
};

class Enqueue : public ::testing::TestWithParam<std::string> {
 protected:
  /// Moves boxes over some frames, waits for every tenth only, and compares all changes with the oracle's.
  /// @param capacity Of the lists of changes.
  void follow_oracle(std::uint32_t n, std::size_t capacity, int frames = 25) {
    Scene scene(queue_, n);
    broad_phase_.reserve(n, std::size_t{n} * 40, true);
    const std::array counts{n, n, n, n / 2, n, 1U, 0U, n, n, n - 1};
    for (int frame = 0; frame < frames; ++frame) {
      const Lists lists(queue_, capacity);
      const auto boxes =
          scene.advance(counts.at(static_cast<std::size_t>(frame) % counts.size()), frame > frames / 2);
      if (frame % 10 == 9) {
        const auto result = broad_phase_.update(boxes);
        const Delta expected = scene.oracle();
        ASSERT_TRUE(same("added", queue_.read(result.added), expected.added)) << "frame " << frame;
        ASSERT_TRUE(same("removed", queue_.read(result.removed), expected.removed)) << "frame " << frame;
        ASSERT_EQ(result.incomplete, 0U);
        continue;
      }
      broad_phase_.enqueue(boxes, lists.arguments);
      const Delta expected = scene.oracle();
      ASSERT_TRUE(has_changes(lists, expected, scene.oracle_pairs().size())) << "frame " << frame;
    }
    ASSERT_TRUE(same("all", queue_.read(broad_phase_.pairs()), scene.oracle_pairs()));
  }

  [[nodiscard]] ::testing::AssertionResult has_changes(const Lists& lists, const Delta& expected,
                                                       std::size_t pairs) const {
    const auto words = queue_.read_counts(lists.counts);
    if (words[3] != 0) return ::testing::AssertionFailure() << "the update is incomplete";
    if (words[2] != pairs) return ::testing::AssertionFailure() << words[2] << " pairs, expected " << pairs;
    const auto added = same("added", queue_.read({lists.added(), words[0]}), expected.added);
    return added ? same("removed", queue_.read({lists.removed(), words[1]}), expected.removed) : added;
  }

  const CallersQueue queue_;
  DeviceBroadPhase broad_phase_{queue_(), {.algorithm = GetParam()}};
};

SUITE_ALSO_IN(Enqueue, gpu_profile | rusticl);

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_P(Enqueue, SmallFramesFollowTheOracle) {
  follow_oracle(50, 1500, 8);
}

TEST_P(Enqueue, FramesFollowTheOracle) {
  follow_oracle(400, 4000);
}

/// Lists long enough to be ordered by buckets.
TEST_P(Enqueue, FramesWithLongListsFollowTheOracle) {
  follow_oracle(600, 20'000);
}

/// Whichever of several updates does not fit, it and all later ones change nothing and report this; the next
/// call that waits has all changes since the last update that fitted.
ALSO_IN(oclgrind);
TEST_P(Enqueue, SmallUpdatesThatDoNotFitChangeNothing) {
  constexpr std::uint32_t n = 60;
  for (const std::size_t too_large : {0U, 1U, 3U}) {
    Scene scene(queue_, n);
    DeviceBroadPhase broad_phase(queue_(), {.algorithm = GetParam()});
    for (int frame = 0; frame < 2; ++frame) {  // so that some pairs were added and some kept
      (void)broad_phase.update(scene.advance(n));
      (void)scene.oracle();
    }
    broad_phase.reserve(n, 5000, true);
    std::vector<Lists> lists;
    for (std::size_t frame = 0; frame < 5; ++frame) {
      lists.emplace_back(queue_, frame == too_large ? 1 : 5000);
      const auto boxes = scene.advance(frame == 3 ? n / 2 : n, frame >= too_large);
      broad_phase.enqueue(boxes, lists.back().arguments);
      const auto pairs = static_cast<std::uint32_t>(scene.oracle_pairs().size());
      if (frame < too_large) {
        const Delta expected = scene.oracle();
        ASSERT_TRUE(has_changes(lists.back(), expected, scene.oracle_pairs().size())) << frame;
      } else {
        EXPECT_EQ(queue_.read_counts(lists.back().counts), (std::array<std::uint32_t, 4>{0, 0, pairs, 1}));
      }
    }
    EXPECT_TRUE(same("known", queue_.read(broad_phase.pairs()), scene.oracle_pairs()));
    const auto result = broad_phase.update(scene.advance(n));
    const Delta expected = scene.oracle();
    EXPECT_TRUE(same("added", queue_.read(result.added), expected.added)) << too_large;
    EXPECT_TRUE(same("removed", queue_.read(result.removed), expected.removed)) << too_large;
    EXPECT_EQ(result.incomplete, 5 - too_large);
  }
}

/// The exclusions of incomplete updates are not mistaken for those of the last complete one.
ALSO_IN(oclgrind);
TEST_P(Enqueue, SmallUpdatesThatDoNotFitExcludeNothing) {
  constexpr std::uint32_t n = 8;
  const cl::Buffer together = queue_.buffer_of(std::vector<Aabb>(n, unit));
  const DeviceBroadPhase::Boxes boxes{.buffer = together(), .count = n};
  const Lists short_lists(queue_, 1);
  const Lists lists(queue_, 100);
  broad_phase_.reserve(n, 100);
  const Pairs excluded{{0, 1}, {0, 2}, {3, 5}};
  const Pairs others{{0, 1}, {6, 7}};
  (void)broad_phase_.update(boxes);
  broad_phase_.set_exclusions(excluded);
  for (int k = 0; k < 2; ++k) broad_phase_.enqueue(boxes, short_lists.arguments);
  EXPECT_EQ(queue_.read(broad_phase_.pairs()), all_pairs(n));
  broad_phase_.enqueue(boxes, lists.arguments);
  EXPECT_TRUE(has_changes(lists, {.added = {}, .removed = excluded}, 25));
  broad_phase_.set_exclusions(others);
  broad_phase_.enqueue(boxes, short_lists.arguments);
  const auto result = broad_phase_.update(boxes);
  EXPECT_EQ(queue_.read(result.added), (Pairs{{0, 2}, {3, 5}}));
  EXPECT_EQ(queue_.read(result.removed), (Pairs{{6, 7}}));
  EXPECT_EQ(result.incomplete, 3U);
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
    std::size_t known = queue_.read(broad_phase_.pairs()).size();
    const std::size_t all = waiting * (waiting - 1) / 2;
    ASSERT_EQ(broad_phase_.update({.buffer = together(), .count = waiting}).pair_count, all);
    known = all;
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
  DeviceBroadPhase broad_phase(queue(), {.algorithm = "tiles"});
  Scene scene(queue, n);
  const auto sorts_of_update = [&](std::size_t incomplete) {
    const long before = launches_of("tiles_keys");
    EXPECT_EQ(broad_phase.update(scene.advance(n)).incomplete, incomplete);
    return launches_of("tiles_keys") - before;
  };
  EXPECT_EQ(sorts_of_update(0), 1);
  EXPECT_EQ(sorts_of_update(0), 0);
  const Lists lists(queue, 1);
  broad_phase.reserve(n, 20'000);
  broad_phase.enqueue(scene.advance(n), lists.arguments);
  EXPECT_EQ(sorts_of_update(1), 1);
  EXPECT_EQ(sorts_of_update(0), 0);
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
  Scene scene(queue_, 500);
  broad_phase_.reserve(500, 20'000, true);
  const Lists lists(queue_, 5000);
  std::vector<DeviceBroadPhase::Boxes> frames;
  frames.reserve(12);
  for (int frame = 0; frame < 12; ++frame) frames.push_back(scene.advance(500, frame > 6));
  const long start = opencl_use().blocking_calls;
  for (const auto& boxes : frames) broad_phase_.enqueue(boxes, lists.arguments);
  EXPECT_EQ(opencl_use().blocking_calls, start);
  EXPECT_LT(broad_phase_.profile().size(), 10U);  // those of one update
  EXPECT_EQ(queue_.read_counts(lists.counts)[3], 0U);
}

TEST_P(Enqueue, BadInputIsNamed) {
  Scene scene(queue_, 10);
  const auto boxes = scene.advance(10);
  const auto filtered = scene.advance(10, true);
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
