#include <algorithm>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "device_limits.hpp"
#include "each_algorithm.hpp"
#include "engines/device_objects.hpp"
#include "environment.hpp"
#include "failing_opencl.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"
#include "runs.hpp"
#include "short_life.hpp"
#include "test_name.hpp"
#include "trouble.hpp"
#include "warped.hpp"

/// Devices that fail: every call does all of its work or none.
namespace broadcl::test {
namespace {

using OpenClTrouble = Trouble<FailingOpenCl, FailingOpenCl::calls>;

/// All device memory that was allocated meanwhile must be gone, unless the device failed to give it back.
struct DeviceMemoryWatch {
  OpenClUse before = opencl_use();

  void expect_nothing_left(long failures) const {
    EXPECT_EQ(opencl_use().memory_references, before.memory_references);
    if (failures > 1 || FailingOpenCl::last_failed() == "clEnqueueUnmapMemObject") return;
    EXPECT_EQ(opencl_use().mapped_regions, before.mapped_regions) << FailingOpenCl::last_failed();
  }
};

std::string name_of(long first, long count) {
  return "call " + std::to_string(first) + (count == 1 ? "" : " and those after it");
}

/// OpenCL calls start to fail at a different one in each life, on a device that works again later.
constexpr auto expect_host_lives = expect_short_lives<OpenClTrouble, DeviceMemoryWatch>;
constexpr auto expect_lives_on_device = expect_device_lives<OpenClTrouble, DeviceMemoryWatch>;
/// Lives with each change; LongDeviceFailure has one for every call.
constexpr long most_lives = 16;

NOT_IN(gpu_profile | rusticl | sanitizers,
       "fails on purpose, also where buffers are unmapped, and takes long");
TEST_P(EachDeviceAlgorithm, ACallThatFailsMayBeRepeated) {
  expect_host_lives(config(), 1, most_lives, true);
}

NOT_IN(gpu_profile | rusticl | sanitizers,
       "fails on purpose, also where buffers are unmapped, and takes long");
TEST_P(EachDeviceAlgorithm, ACallThatFailsInDoublePrecisionMayBeRepeated) {
  expect_short_lives<OpenClTrouble, DeviceMemoryWatch, Warped<BroadPhase64>>(config(), 1, most_lives, true);
}

NOT_IN(gpu_profile | rusticl | sanitizers,
       "fails on purpose, also where buffers are unmapped, and takes long");
TEST_P(EachDeviceAlgorithm, ADeviceThatFailsForSomeTimeLosesNothing) {
  expect_host_lives(config(), OpenClTrouble::for_good, most_lives / 2, true);
}

class DeviceFailure : public ::testing::TestWithParam<std::string> {};
SUITE_NOT_IN(DeviceFailure, gpu_profile | rusticl | sanitizers,
             "fails on purpose, also where buffers are unmapped, and takes long");
const auto finders = ::testing::Values("brute-force", "tiles");
INSTANTIATE_TEST_SUITE_P(Table, DeviceFailure, finders, named_by_parameter);

TEST_P(DeviceFailure, WhicheverCallOfADeviceBroadPhaseFailsMayBeRepeated) {
  expect_lives_on_device(GetParam(), 1, most_lives);
}

TEST_P(DeviceFailure, ADeviceBroadPhaseGoesOnWhenTheDeviceWorksAgain) {
  expect_lives_on_device(GetParam(), OpenClTrouble::for_good, most_lives / 2);
}

TEST_P(DeviceFailure, WithDirectMemoryACallThatFailsMayBeRepeatedToo) {
  const LimitedDevices limited(device_with_direct_memory());
  expect_lives_on_device(GetParam(), 1, most_lives);
  expect_host_lives({.algorithm = GetParam()}, 1, most_lives, true);
}

/// Every call: the failure of it alone, and for some of it and all later ones.
class LongDeviceFailure : public DeviceFailure {};
INSTANTIATE_TEST_SUITE_P(Long, LongDeviceFailure, finders, named_by_parameter);
TEST_P(LongDeviceFailure, OfEveryCallIsMadeGood) {
  for (const auto& [count, most] :
       {std::pair{1L, OpenClTrouble::for_good}, {OpenClTrouble::for_good, 200L}}) {
    expect_lives_on_device(GetParam(), count, most);
    expect_host_lives({.algorithm = GetParam()}, count, most, true);
  }
}

/// Calls a function again and again while one of its OpenCL calls fails, or all from it on: first call
/// `from`, then later and later ones, `step` calls apart up to the 150th and 101 apart after it. The function
/// may throw Error and nothing else.
template <class Function>
void expect_errors_alone(long from, long step, const Function& function) {
  for (const long count : {1L, OpenClTrouble::for_good}) {
    long errors = 0;
    bool is_over = false;
    for (long first = from; !is_over; first += is_slow_device() || first > 150 ? 101 : step) {
      SCOPED_TRACE(name_of(first, count));
      const DeviceMemoryWatch watch;
      const FailingOpenCl fails(first, count);
      try {
        function();
        is_over = FailingOpenCl::calls() <= first;
      } catch (const Error&) {
        ++errors;
        watch.expect_nothing_left(count);
      } catch (const std::exception& error) {
        ADD_FAILURE() << "an exception other than Error escapes: " << error.what();
      }
    }
    EXPECT_GT(errors, 1);
  }
}

TEST(DeviceFailure, ListingDevicesThrowsErrorsAlone) {
  expect_errors_alone(0, 1, [] { EXPECT_FALSE(devices().empty()); });
}

NOT_IN(gpu_profile | rusticl | sanitizers,
       "fails on purpose, also where buffers are unmapped, and takes long");
TEST_P(EachDeviceAlgorithm, ConstructorsOnAFailingDeviceThrowErrorsAlone) {
  const ScopedFolder folder;
  const ScopedVariable variable("BROADCL_CACHE_DIR", folder.path().string());
  expect_errors_alone(0, 7, [] { BroadPhase broad_phase(config()); });
}

/// As above, but with kernels that are already compiled, and a device that is measured each time.
TEST(LongDeviceFailure, MeasuringAFailingDeviceThrowsErrorsAlone) {
  const ScopedFolder kernels;
  {
    const ScopedVariable variable("BROADCL_CACHE_DIR", kernels.path().string());
    for (const std::string algorithm : {"brute-force", "tiles"}) BroadPhase({.algorithm = algorithm});
  }
  expect_errors_alone(60, 29, [&] {
    const ScopedFolder folder;
    std::filesystem::copy(kernels.path(), folder.path());
    const ScopedVariable variable("BROADCL_CACHE_DIR", folder.path().string());
    BroadPhase broad_phase({.algorithm = "auto"});
  });
}

/// The device fails during a life, and still fails when the object is destroyed.
NOT_IN(gpu_profile | rusticl | sanitizers,
       "fails on purpose, also where buffers are unmapped, and takes long");
TEST_P(EachDeviceAlgorithm, AnObjectMayGoWhileItsDeviceFails) {
  long errors = 0;
  bool is_on_host = false;  // `auto` may be
  for (long first = 0, calls = 1; first < calls; first += 100) {
    SCOPED_TRACE(name_of(first, OpenClTrouble::for_good));
    std::optional<BroadPhase> broad_phase(config());
    is_on_host = broad_phase->device() == nullptr;
    const FailingOpenCl all_fail(first, OpenClTrouble::for_good);
    try {
      for (std::uint32_t k = 0; k < 300; ++k) broad_phase->add(unit);
      (void)broad_phase->update();
      broad_phase->move(1, apart(1));
      broad_phase->begin();
    } catch (const Error&) {
      ++errors;
      calls = first + 1000;
    }
    calls = std::max(calls, FailingOpenCl::calls());
    broad_phase.reset();
  }
  EXPECT_EQ(errors == 0, is_on_host);
}

/// Boxes that have memory also have memory for their filters, so a call that failed may be repeated.
TEST(DeviceFailure, NoBoxesHaveMemoryWithoutFilters) {
  constexpr std::size_t n = 20'000;
  for (long first = 0, calls = 1; first < calls; ++first) {
    SCOPED_TRACE(name_of(first, 1));
    const opencl::Context context(select_device(), false);
    opencl::Profiler profiler(false);
    Frames frames;
    DeviceObjects objects(context, profiler, frames);
    objects.reserve(1, true);
    const FailingOpenCl one_fails(first, 1);
    try {
      objects.reserve(n, true);
      EXPECT_GE(objects.boxes().size(), n);
    } catch (const cl::Error&) {
      calls = first + 2;
      EXPECT_LT(objects.boxes().size(), n);
    }
    calls = std::max(calls, FailingOpenCl::calls());
  }
}

}  // namespace
}  // namespace broadcl::test
