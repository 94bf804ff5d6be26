#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "callers_queue.hpp"
#include "device_stages.hpp"
#include "each_algorithm.hpp"
#include "failing_opencl.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"
#include "runs.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"

namespace broadcl::opencl {
namespace {

using std::chrono::steady_clock;
constexpr double nanosecond = 1e-9;

double host_end(const Stage& stage) {
  return stage.host_start + stage.host_seconds;
}

double device_end(const Stage& stage) {
  return stage.device_start + stage.device_seconds;
}

double seconds_since(steady_clock::time_point start) {
  return std::chrono::duration<double>(steady_clock::now() - start).count();
}

void pass_time() {
  std::this_thread::sleep_for(std::chrono::milliseconds(2));
}

std::vector<std::string_view> names_of(std::span<const Stage> stages) {
  std::vector<std::string_view> names;
  for (const Stage& stage : stages) names.push_back(stage.name);
  return names;
}

TEST(Profiler, NestedScopesAreStagesWithinStages) {
  Profiler profiler(false);
  profiler.begin();
  {
    const Profiler::Scope outer(profiler, "outer");
    pass_time();
    {
      const Profiler::Scope inner(profiler, "inner");
      pass_time();
    }
    pass_time();
  }
  ASSERT_EQ(names_of(profiler.stages()), (std::vector<std::string_view>{"outer", "inner"}));
  const Stage& outer = profiler.stages()[0];
  const Stage& inner = profiler.stages()[1];
  EXPECT_GE(inner.host_seconds, 0.002);
  EXPECT_GE(inner.host_start, outer.host_start + 0.002);
  EXPECT_GE(host_end(outer), host_end(inner) + 0.002);
}

TEST(Profiler, OverlappingScopesHaveTheirOwnTimes) {
  Profiler profiler(false);
  profiler.begin();
  std::optional<Profiler::Scope> first;
  std::optional<Profiler::Scope> second;
  first.emplace(profiler, "first");
  pass_time();
  second.emplace(profiler, "second");
  pass_time();
  first.reset();
  pass_time();
  second.reset();
  ASSERT_EQ(names_of(profiler.stages()), (std::vector<std::string_view>{"first", "second"}));
  const Stage& one = profiler.stages()[0];
  const Stage& two = profiler.stages()[1];
  EXPECT_GE(two.host_start, one.host_start + 0.002);
  EXPECT_GE(host_end(one), two.host_start + 0.002);
  EXPECT_GE(host_end(two), host_end(one) + 0.002);
}

TEST(Profiler, KeepsStagesOfOneNameAndTheTimeBetweenThem) {
  Profiler profiler(false);
  profiler.begin();
  { const Profiler::Scope stage(profiler, "test"); }
  pass_time();
  { const Profiler::Scope stage(profiler, "test"); }
  ASSERT_EQ(names_of(profiler.stages()), (std::vector<std::string_view>{"test", "test"}));
  EXPECT_GE(profiler.stages()[1].host_start, host_end(profiler.stages()[0]) + 0.002);
}

TEST(Profiler, StartsCountFromTheBeginningOfTheUpdate) {
  Profiler profiler(false);
  { const Profiler::Scope stage(profiler, "last update"); }
  pass_time();
  const auto begin = steady_clock::now();
  profiler.begin();
  EXPECT_TRUE(profiler.stages().empty());
  { const Profiler::Scope stage(profiler, "this update"); }
  const double elapsed = seconds_since(begin);
  ASSERT_EQ(names_of(profiler.stages()), (std::vector<std::string_view>{"this update"}));
  EXPECT_GE(profiler.stages()[0].host_start, 0);
  EXPECT_LE(host_end(profiler.stages()[0]), elapsed + nanosecond);
}

class DeviceProfiler : public testing::Test {
 protected:
  void fill(cl::Event* event) {
    context_.queue().enqueueFillBuffer(buffer_, cl_uint{1}, 0, bytes, nullptr, event);
  }

  static constexpr std::size_t bytes = 1 << 22;
  Context context_{select_device({}), true};
  cl::Buffer buffer_{context_.context(), CL_MEM_READ_WRITE, bytes};
  Profiler profiler_{true};
};

SUITE_ALSO_IN(DeviceProfiler, rusticl);

TEST_F(DeviceProfiler, CommandsAreInOrderAndDoNotOverlap) {
  profiler_.begin();
  for (const std::string_view name : {"first", "second", "third"}) {
    Profiler::Scope stage(profiler_, name);
    fill(stage.event());
  }
  context_.queue().finish();
  profiler_.resolve();
  const std::span<const Stage> stages = profiler_.stages();
  ASSERT_EQ(stages.size(), 3U);
  EXPECT_EQ(stages[0].device_start, 0);
  for (const Stage& stage : stages) EXPECT_GT(stage.device_seconds, 0) << stage.name;
  if (!test::device_clock_ticks()) return;
  for (std::size_t k = 1; k < stages.size(); ++k) {
    EXPECT_GE(stages[k].device_start, device_end(stages[k - 1]) - nanosecond / 2) << stages[k].name;
  }
}

/// The outer stage asks for an event first, but its command comes after those of the stages within it.
TEST_F(DeviceProfiler, EventsBelongToTheirScopeHoweverScopesNest) {
  constexpr std::size_t inner_stages = 100;
  profiler_.begin();
  {
    Profiler::Scope outer(profiler_, "outer");
    cl::Event* const event = outer.event();
    for (std::size_t k = 0; k < inner_stages; ++k) {
      Profiler::Scope inner(profiler_, "inner");
      EXPECT_NE(inner.event(), event);
      if (k == 0) fill(inner.event());
    }
    fill(event);
  }
  context_.queue().finish();
  profiler_.resolve();
  const std::span<const Stage> stages = profiler_.stages();
  ASSERT_EQ(stages.size(), 1 + inner_stages);
  EXPECT_GT(stages[0].device_seconds, 0);
  EXPECT_GT(stages[1].device_seconds, 0);
  EXPECT_EQ(stages[1].device_start, 0) << "its command was the first";
  if (test::device_clock_ticks()) {
    EXPECT_GE(stages[0].device_start, device_end(stages[1]) - nanosecond / 2);
  }
  for (std::size_t k = 2; k < stages.size(); ++k) {
    EXPECT_EQ(stages[k].device_start, 0);
    EXPECT_EQ(stages[k].device_seconds, 0);
  }
}

TEST_F(DeviceProfiler, TheTimeOfAStageIsThatOfAllItsCommands) {
  std::array<cl::Event, 3> events;
  profiler_.begin();
  {
    Profiler::Scope stage(profiler_, "three");
    for (cl::Event& event : events) {
      cl::Event* const own = stage.event();
      fill(own);
      event = *own;
    }
    (void)stage.event();  // for a command that was not enqueued in the end
  }
  context_.queue().finish();
  profiler_.resolve();
  double sum = 0;
  for (const cl::Event& event : events) {
    sum += static_cast<double>(event.getProfilingInfo<CL_PROFILING_COMMAND_END>() -
                               event.getProfilingInfo<CL_PROFILING_COMMAND_START>()) *
           nanosecond;
  }
  EXPECT_EQ(profiler_.stages()[0].device_start, 0);
  EXPECT_NEAR(profiler_.stages()[0].device_seconds, sum, nanosecond);
}

TEST_F(DeviceProfiler, AStageWithoutACommandHasNoDeviceTime) {
  profiler_.begin();
  { const Profiler::Scope stage(profiler_, "before"); }
  {
    Profiler::Scope stage(profiler_, "fill");
    fill(stage.event());
  }
  {
    const Profiler::Scope stage(profiler_, "wait");
    context_.queue().finish();
  }
  profiler_.resolve();
  ASSERT_EQ(profiler_.stages().size(), 3U);
  for (const std::size_t k : {0U, 2U}) {
    EXPECT_EQ(profiler_.stages()[k].device_start, 0);
    EXPECT_EQ(profiler_.stages()[k].device_seconds, 0);
    EXPECT_GT(profiler_.stages()[k].host_seconds, 0);
  }
  EXPECT_EQ(profiler_.stages()[1].device_start, 0);
  EXPECT_GT(profiler_.stages()[1].device_seconds, 0);
}

TEST_F(DeviceProfiler, WithoutDeviceTimesThereAreNoEvents) {
  Profiler profiler(false);
  profiler.begin();
  {
    Profiler::Scope stage(profiler, "fill");
    EXPECT_EQ(stage.event(), nullptr);
    fill(stage.event());
  }
  context_.queue().finish();
  profiler.resolve();
  EXPECT_EQ(profiler.stages()[0].device_seconds, 0);
  EXPECT_GT(profiler.stages()[0].host_seconds, 0);
}

TEST_F(DeviceProfiler, AnUpdateWithoutAnyCommandResolves) {
  profiler_.begin();
  profiler_.resolve();
  EXPECT_TRUE(profiler_.stages().empty());
  { const Profiler::Scope stage(profiler_, "host"); }
  profiler_.resolve();
  EXPECT_EQ(profiler_.stages()[0].device_seconds, 0);
}

/// More pairs than the first capacity, so the frame runs twice: both runs are in the profile.
TEST(BruteForceProfile, HasBothRunsOfAFrameThatIsRunAgain) {
  BroadPhase broad_phase({.algorithm = "brute-force", .profile = true});
  for (int k = 0; k < 300; ++k) broad_phase.add({{0, 0, 0}, {1, 1, 1}});
  const long tests = test::launches_of("brute_force");
  const auto begin = steady_clock::now();
  EXPECT_EQ(broad_phase.update().added.size(), 44'850U);
  const double elapsed = seconds_since(begin);
  EXPECT_EQ(test::launches_of("brute_force") - tests, 2);
  const std::span<const Stage> stages = broad_phase.profile();
  const auto names = names_of(stages);
  EXPECT_LT(std::set<std::string_view>(names.begin(), names.end()).size(), names.size());
  double sum = 0;
  for (std::size_t k = 0; k < stages.size(); ++k) {
    sum += stages[k].host_seconds;
    if (k > 0) {
      EXPECT_GE(stages[k].host_start, host_end(stages[k - 1]) - nanosecond) << names[k];
    }
  }
  EXPECT_LE(sum, elapsed);
  EXPECT_LE(host_end(stages.back()), elapsed);
}

/// Whatever a frame does, each of its kernels and copies counts, so that the stages add up to the frame.
class EveryCommand : public ::testing::TestWithParam<AlgorithmInfo> {
 protected:
  static void expect_timed(const std::string& what, const std::function<void()>& update) {
    const long before = test::opencl_use().commands_without_event;
    update();
    EXPECT_EQ(test::opencl_use().commands_without_event, before) << what;
  }
};

TEST_P(EveryCommand, IsTimed) {
  const std::string algorithm(GetParam().name);
  BroadPhase broad_phase({.algorithm = algorithm, .profile = true});
  const std::uint32_t n = test::is_slow_device() ? 1200 : 6000;
  scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::uniform);
  for (const Aabb& box : boxes.boxes()) broad_phase.add(box);
  const auto update = [&](const std::string& what) {
    expect_timed(what, [&] { (void)broad_phase.update(); });
  };
  update("the first frame");
  for (int frame = 0; frame < 3; ++frame) {
    std::ranges::copy(boxes.boxes(), broad_phase.map(n).begin());
    update("all moved");
    boxes.advance();
  }
  for (std::uint32_t frame = 0; frame < 4; ++frame) {
    for (std::uint32_t k = 0; k < 20; ++k) broad_phase.move(k * 50 + frame, boxes.boxes()[k]);
    update("some moved");
  }
  for (std::uint32_t frame = 0; frame < 4; ++frame) {
    broad_phase.set_filter(frame, {.group = 2, .world = frame % 2});
    broad_phase.set_exclusions(std::array{Pair{frame, 10}});
    broad_phase.remove(n - 1 - frame);
    update("filters, worlds and exclusions");
  }
  std::ranges::fill_n(broad_phase.map(n).begin(), 400, test::unit);
  update("many more pairs than expected");
}

/// Of a DeviceBroadPhase.
class EveryCommandOfADevice : public EveryCommand {};

/// Objects that are on the device already, in several worlds, and in two sets.
TEST_P(EveryCommandOfADevice, IsTimed) {
  const test::CallersQueue queue(CL_QUEUE_PROFILING_ENABLE);
  constexpr std::uint32_t n = 1500;
  scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::uniform);
  std::vector<Filter> filters(n);
  for (std::uint32_t k = 0; k < n; ++k) filters[k].world = k % 3;
  const cl::Buffer filter_buffer = queue.buffer_of(filters);
  for (const bool is_of_sets : {false, true}) {
    DeviceBroadPhase broad_phase(queue(), {.algorithm = std::string(GetParam().name), .profile = true});
    for (int frame = 0; frame < 4; ++frame) {
      boxes.advance();
      const cl::Buffer all = queue.buffer_of(std::vector<Aabb>(boxes.boxes().begin(), boxes.boxes().end()));
      DeviceBroadPhase::Boxes given{
          .buffer = all(), .count = n, .filters = filter_buffer(), .ordered_worlds = 3};
      if (is_of_sets) {
        given = {.buffer = all(), .count = n / 2};
        given.second = {.buffer = all(), .count = n / 2};
      }
      expect_timed(is_of_sets ? "two sets" : "worlds", [&] { (void)broad_phase.update(given); });
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Table, EveryCommand, ::testing::ValuesIn(test::device_algorithms()),
                         test::named_by_parameter);
INSTANTIATE_TEST_SUITE_P(Table, EveryCommandOfADevice, ::testing::ValuesIn([] {
                           std::vector<AlgorithmInfo> rows = test::device_algorithms();
                           std::erase_if(rows, [](const AlgorithmInfo& row) { return row.name == "gpu-bf"; });
                           return rows;
                         }()),
                         test::named_by_parameter);

}  // namespace
}  // namespace broadcl::opencl
