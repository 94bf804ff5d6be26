#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include "callers_queue.hpp"
#include "device_limits.hpp"
#include "each_algorithm.hpp"
#include "environment.hpp"
#include "failing_opencl.hpp"
#include "opencl/context.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"
#include "twins.hpp"

/// Devices whose kernels access host memory while it is mapped, as with NVIDIA's driver.
namespace broadcl::test {
namespace {

class DirectMemory : public ::testing::Test {
 protected:
  Limits limits_ = device_with_direct_memory();

  /// Whether a device is found to have it that nothing is known about.
  [[nodiscard]] bool is_found() const {
    const LimitedDevices limited(limits_);
    return opencl::Context(select_device(), false).has_direct_memory();
  }

 private:
  ScopedFolder folder_;
  ScopedVariable cache_{"BROADCL_CACHE_DIR", folder_.path().string()};
};

TEST_F(DirectMemory, IsFound) {
  EXPECT_TRUE(is_found());
}

TEST_F(DirectMemory, IsThatOfAnExtension) {
  limits_.answers[CL_DEVICE_EXTENSIONS] = std::string("cl_nv_copy_opts") + '\0';
  EXPECT_FALSE(is_found());
  limits_ = device_with_direct_memory();
  limits_.has_direct_memory = false;  // it is listed, but has no function
  EXPECT_FALSE(is_found());
}

TEST_F(DirectMemory, IsOfNoUseIfHostAndDeviceShareMemoryAnyway) {
  limits_.answers[CL_DEVICE_HOST_UNIFIED_MEMORY] = answer(cl_bool{CL_TRUE});
  EXPECT_FALSE(is_found());
}

TEST_F(DirectMemory, IsNotUsedIfTheDriverCopiesIt) {
  limits_.is_direct_memory_copied = true;
  EXPECT_FALSE(is_found());
}

TEST_F(DirectMemory, IsFoundLaterIfACallFailsDuringTheTest) {
  bool has_failed = false;
  for (long first = 0; first < 100 && !has_failed; ++first) {
    const ScopedFolder folder;
    const ScopedVariable cache("BROADCL_CACHE_DIR", folder.path().string());
    {
      const FailingOpenCl fails(first, 1);
      try {
        (void)is_found();
      } catch (const Error&) {  // a call failed before or after the test
        continue;
      }
      has_failed = FailingOpenCl::last_failed() == "clCreateBufferNV";
    }
    if (has_failed) {
      EXPECT_TRUE(is_found());
    }
  }
  EXPECT_TRUE(has_failed);
}

TEST_F(DirectMemory, IsTestedOncePerDevice) {
  const auto calls = [&] {
    const FailingOpenCl none(std::numeric_limits<long>::max(), 1);
    EXPECT_TRUE(is_found());
    return FailingOpenCl::calls();
  };
  const long first = calls();
  EXPECT_LT(calls(), first - 10);
}

class WithDirectMemory : public ::testing::TestWithParam<std::string> {
  LimitedDevices limited_{device_with_direct_memory()};
};
INSTANTIATE_TEST_SUITE_P(Table, WithDirectMemory, ::testing::Values("brute-force", "tiles"),
                         named_by_parameter);

/// Few and many boxes and changes, because only few of them are in direct memory.
NOT_IN(sanitizers, "takes long in the reference, which tests each pair");
TEST_P(WithDirectMemory, FewAndManyChangesAreRight) {
  Twins twins({.algorithm = GetParam()});
  for (const std::uint32_t n : {40U, 3000U, 30U, 5000U, 50U}) {
    SCOPED_TRACE(n);
    scenes::MovingBoxes scene(n, scenes::MovingBoxes::Sizes::uniform);
    for (int frame = 0; frame < 3; ++frame) {
      twins.map(n, [&](std::span<Aabb> boxes) { std::ranges::copy(scene.boxes(), boxes.begin()); });
      ASSERT_TRUE(twins.agree());
      scene.advance();
    }
    for (const std::uint32_t moving : {5U, n / 4, 7U}) {
      for (std::uint32_t id = 0; id < moving; ++id) twins.move(id, scene.boxes()[id]);
      ASSERT_TRUE(twins.agree());
      scene.advance();
    }
  }
  twins.move(3, apart(7));
  const long before = opencl_use().transfers;
  EXPECT_TRUE(twins.agree([&](const Delta& /*delta*/) { EXPECT_EQ(opencl_use().transfers, before); }));
}

TEST_P(WithDirectMemory, BeginDoesNotBlock) {
  const CallersQueue queue;
  DeviceBroadPhase broad_phase(queue(), {.algorithm = GetParam()});
  const cl::Buffer boxes = queue.buffer_of(std::vector<Aabb>(10, unit));
  for (int frame = 0; frame < 4; ++frame) {
    const long before = opencl_use().blocking_calls;
    broad_phase.begin({.buffer = boxes(), .count = 10});
    EXPECT_EQ(opencl_use().blocking_calls, before) << frame;
    EXPECT_EQ(broad_phase.finish().pair_count, 45U);
  }
}

TEST_P(WithDirectMemory, AKeptDeltaStaysAsItIs) {
  BroadPhase broad_phase({.algorithm = GetParam()});
  for (int k = 0; k < 20; ++k) broad_phase.add(unit);
  const Delta first = broad_phase.update();
  const Pairs added = to_vector(first.added);
  ASSERT_EQ(added.size(), 190U);
  for (std::uint32_t id = 0; id < 6; ++id) {
    broad_phase.move(id, apart(id));
    (void)broad_phase.update();
  }
  broad_phase = BroadPhase({.algorithm = "oracle"});
  EXPECT_TRUE(same(first, added, {}));
}

/// The caller may enqueue commands after begin(), which finish() must not wait for.
TEST_P(WithDirectMemory, ADeviceBroadPhaseWaitsForItsOwnCommandsAlone) {
  const CallersQueue queue;
  DeviceBroadPhase broad_phase(queue(), {.algorithm = GetParam()});
  const cl::Buffer boxes = queue.buffer_of(std::vector<Aabb>(10, unit));
  const cl::CommandQueue commands(queue(), true);
  cl::UserEvent later(commands.getInfo<CL_QUEUE_CONTEXT>());
  for (const std::size_t count : {10U, 9U}) {
    broad_phase.begin({.buffer = boxes(), .count = count});
    const std::vector<cl::Event> events{later};
    if (count == 9) commands.enqueueBarrierWithWaitList(&events);
    const DeviceBroadPhase::Result result = broad_phase.finish();
    EXPECT_EQ(result.pair_count, count * (count - 1) / 2);
  }
  later.setStatus(CL_COMPLETE);
  commands.finish();
}

}  // namespace
}  // namespace broadcl::test
