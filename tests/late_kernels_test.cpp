#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/opencl.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "device_limits.hpp"
#include "device_twins.hpp"
#include "each_algorithm.hpp"
#include "environment.hpp"
#include "expect_error.hpp"
#include "failing_opencl.hpp"
#include "runs.hpp"
#include "short_life.hpp"
#include "trouble.hpp"
#include "twins.hpp"

/// Kernels that are built when they are first needed, in the middle of a life, and that the device runs only
/// in small work-groups.
namespace broadcl::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

/// Also counts the calls that block, if none fails.
class LateTrouble : public Trouble<FailingOpenCl, FailingOpenCl::calls> {
 public:
  using Trouble::Trouble;

  template <class Function, class AfterFailure>
  auto call(const Function& function, const AfterFailure& after_failure) {
    blocking_before_ = opencl_use().blocking_calls;
    return Trouble::call(
        [&] {
          const Watch watch(*this);
          return function();
        },
        after_failure);
  }
  [[nodiscard]] long blocking_calls() const { return failures() > 0 ? 0 : blocking_calls_; }

 private:
  struct Watch {
    explicit Watch(LateTrouble& trouble) : trouble_(trouble) {}
    ~Watch() { trouble_.blocking_calls_ = opencl_use().blocking_calls - trouble_.blocking_before_; }
    Watch(const Watch&) = delete;
    Watch& operator=(const Watch&) = delete;
    Watch(Watch&&) = delete;
    Watch& operator=(Watch&&) = delete;
    LateTrouble& trouble_;
  };
  long blocking_before_ = 0;
  long blocking_calls_ = 0;
};

/// The OpenCL call of an update that fails, if any.
using LateFailure = std::optional<long>;

LateTrouble trouble_of(LateFailure failure) {
  return {failure.value_or(0), failure ? 1 : 0};
}

/// If an update failed by itself, its repetition would hide that, so failures are counted.
::testing::AssertionResult fails_only_for(LateFailure failure, const LateTrouble& trouble) {
  if (trouble.failures() <= (failure ? 1 : 0)) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << "an update failed though no call did";
}

SUITE_ALSO_IN(LateKernelOnTheHost, kernels);
SUITE_ALSO_IN(LateKernelOnTheDevice, kernels);
SUITE_ALSO_IN(LateKernel, kernels);

/// An algorithm, and one of its kernels on a GPU.
struct LateKernel {
  const char* algorithm;
  const char* name;  ///< As in Limits::work_group_of_kernel.
  cl_uint wave = 32;

  [[nodiscard]] bool is_for(std::string_view option) const {
    return std::string_view(name).find(option) != std::string_view::npos;
  }
};

std::ostream& operator<<(std::ostream& out, const LateKernel& kernel) {
  return out << kernel.algorithm << ", " << kernel.name << ", " << kernel.wave;
}

std::string name_of_late_kernel(const ::testing::TestParamInfo<LateKernel>& test) {
  std::string name = ::testing::PrintToString(test.param);
  std::erase_if(name, [](char c) { return c == ',' || c == '='; });
  std::ranges::replace_if(
      name, [](char c) { return c == ' ' || c == '-'; }, '_');
  return name;
}

Limits gpu_that_limits(const LateKernel& kernel, std::size_t most) {
  Limits gpu = gpu_with_waves_of(kernel.wave);
  gpu.work_group_of_kernel.emplace(kernel.name, most);
  return gpu;
}

/// A box in a row; it overlaps some of its neighbours.
Aabb late_box(std::uint32_t k) {
  const float x = static_cast<float>(k) * 0.3F;
  return {{x, 0, 0}, {x + 1, 1, 1}};
}

/// Lets the device claim to be a GPU.
class ForAnyDevice {
  ScopedVariable device_{"BROADCL_DEVICE", ""};
  ScopedVariable tuning_{"BROADCL_TUNING", ""};
};

/// A BroadPhase over a few frames; in the last, a kernel is built late.
class LateHostLife {
 public:
  LateHostLife(const LateKernel& kernel, std::uint32_t n)
      : kernel_(kernel),
        n_(n),
        twins_(std::in_place, LateTrouble(0, 0), true, BroadPhase::Config{.algorithm = kernel.algorithm}) {
    for (std::uint32_t k = 0; k < n; ++k) twins_.add(late_box(k));
  }

  /// Everything before the kernel is needed.
  void begin() {
    update();
    if (kernel_.is_for("WORLDS") && kernel_.is_for("SOME_CHANGED")) {
      set_worlds();
      update();
    }
  }

  /// @returns The number of possible failures, if the answers were right.
  std::optional<long> need(LateFailure failure, bool sets) {
    if (kernel_.is_for("SOME_CHANGED")) {
      twins_.move(7, late_box(n_ / 2));
    } else {
      for (std::uint32_t id = 0; sets && id < n_; ++id)
        twins_.set_filter(id, id % 3 == 0 ? Filter::first_set : Filter::second_set);
      if (!sets) set_worlds();
    }
    const long points = update(failure);
    return is_right_ ? std::optional(points) : std::nullopt;
  }

  /// @returns Whether the answers were right.
  bool go_on() {
    twins_.move(7, late_box(7));
    update();
    for (std::uint32_t k = 0; k < n_; ++k) twins_.move(k, late_box(k * 3 % n_));
    update();
    twins_.move(9, late_box(11));
    update();
    return is_right_;
  }

 private:
  void set_worlds() {
    for (std::uint32_t id = 0; id < n_; ++id) twins_.set_filter(id, {.world = id % 2});
  }

  /// @returns The number of possible failures.
  long update(LateFailure failure = std::nullopt) {
    twins_.set_trouble(trouble_of(failure));
    for (const ::testing::AssertionResult& result :
         {twins_.agree(), fails_only_for(failure, twins_.trouble())}) {
      EXPECT_TRUE(result);
      is_right_ = is_right_ && result;
    }
    const long points = twins_.trouble().points();
    twins_.set_trouble(LateTrouble(0, 0));
    return points;
  }

  LateKernel kernel_;
  std::uint32_t n_;
  Twins<BroadPhase, LateTrouble> twins_;
  bool is_right_ = true;
};

/// On a CPU, `auto` compiles the kernels of `tiles` when it first needs them.
TEST(LateTiles, OfAutoLoseNothingIfACallFails) {
  const ScopedVariable tuning("BROADCL_TUNING", "cpu");
  if (select_device().type != DeviceType::cpu) GTEST_SKIP() << "the device is not a CPU";
  const Config config{.device = select_device().id(), .algorithm = "auto"};
  expect_right_lives(12, [&](long first) -> std::optional<long> {
    Twins<BroadPhase, LateTrouble> twins(std::in_place, LateTrouble(first, 1), false, config);
    for (std::uint32_t k = 0; k < 100; ++k) twins.add(late_box(k));
    if (!twins.agree()) return std::nullopt;
    for (std::uint32_t k = 0; k < 100; ++k) twins.set_filter(k, {.world = k % 2});
    if (!twins.agree()) return std::nullopt;
    return twins.trouble().points();
  });
}

class LateKernelOnTheHost : public ::testing::TestWithParam<LateKernel> {
  ForAnyDevice any_;
};

TEST_P(LateKernelOnTheHost, RunsInSmallWorkGroups) {
  for (const bool sets : {false, true}) {
    const LimitedDevices limited(gpu_that_limits(GetParam(), sets ? 1 : 16));
    LateHostLife life(GetParam(), 300);
    life.begin();
    ASSERT_EQ(limited.asked_of_kernels(), 0) << "it was built too early";
    ASSERT_TRUE(life.need(std::nullopt, sets));
    ASSERT_TRUE(life.go_on());
    EXPECT_GT(limited.asked_of_kernels(), 0);
  }
}

/// In each life, another call of the update that needs the kernel fails; there are about `most` lives.
void expect_late_host_lives(const LateKernel& kernel, long most) {
  const LimitedDevices limited(gpu_that_limits(kernel, 16));
  expect_right_lives(most, [&](long first) -> std::optional<long> {
    LateHostLife life(kernel, 60);
    life.begin();
    const std::optional<long> points = life.need(first, false);
    return points && life.go_on() ? points : std::nullopt;
  });
}

constexpr std::array late_on_the_host{LateKernel{"tiles", "tiles_search -DSOME_CHANGED=1", 64},
                                      LateKernel{"tiles", "tiles_search -DWORLDS=1"},
                                      LateKernel{"tiles", "tiles_search -DSOME_CHANGED=1"},
                                      LateKernel{"tiles", "tiles_refit -DWORLDS=1"},
                                      LateKernel{"tiles", "tiles_keys -DWORLDS=1"},
                                      LateKernel{"tiles", "tiles_world_keys -DWORLDS=1"},
                                      LateKernel{"tiles", "centroids -DWORLDS=1"},
                                      LateKernel{"tiles", "tiles_fill -DWORLDS=1", 64}};
INSTANTIATE_TEST_SUITE_P(Table, LateKernelOnTheHost, ::testing::ValuesIn(late_on_the_host),
                         name_of_late_kernel);

/// A DeviceBroadPhase over a few frames; in one of them, a kernel is built late.
class LateDeviceLife {
 public:
  /// @param sets Whether there are two sets, in all frames; otherwise there are worlds, in the last frames.
  /// @param waits Whether to wait for each frame.
  LateDeviceLife(const CallersQueue& queue, const LateKernel& kernel, bool sets, bool waits)
      : kernel_(kernel),
        waits_(waits),
        twins_(queue, {.algorithm = kernel.algorithm}, LateTrouble(0, 0), true) {
    if (sets) frame_.first_count = n / 3;
    twins_.reserve(n, most_pairs);
  }

  /// Everything before the kernel is needed.
  void begin() {
    if (!frame_.first_count && kernel_.is_for("WORLDS")) update();
  }

  /// @returns The number of possible failures, if the answers were right.
  std::optional<long> need(LateFailure failure) {
    frame_.worlds = !frame_.first_count && kernel_.is_for("WORLDS");
    const long points = update(failure);
    return check() ? std::optional(points) : std::nullopt;
  }

  /// @returns Whether the answers were right.
  bool go_on() {
    for (const bool worlds : {true, false, false, true}) {
      frame_.worlds = worlds && !frame_.first_count;
      update();
    }
    return check();
  }

 private:
  static constexpr std::uint32_t n = 60;
  static constexpr std::size_t most_pairs = n * (n - 1) / 2;

  /// @returns The number of possible failures.
  long update(LateFailure failure = std::nullopt) {
    ++turn_;
    frame_.boxes.clear();
    frame_.filters.clear();
    for (std::uint32_t k = 0; k < n; ++k) {
      frame_.boxes.push_back(late_box(k * turn_ % n));
      if (frame_.worlds) frame_.filters.push_back({.world = k % 2});
    }
    twins_.set_trouble(trouble_of(failure));
    if (waits_) {
      expect(twins_.update(frame_));
    } else {
      twins_.enqueue(frame_, most_pairs);
      EXPECT_EQ(twins_.trouble().blocking_calls(), 0);
    }
    expect(fails_only_for(failure, twins_.trouble()));
    const long points = twins_.trouble().points();
    twins_.set_trouble(LateTrouble(0, 0));
    return points;
  }

  /// @returns Whether all answers were right so far.
  bool check() {
    expect(twins_.agree());
    expect(twins_.agree_on_pairs());
    return is_right_;
  }

  void expect(const ::testing::AssertionResult& result) {
    EXPECT_TRUE(result);
    is_right_ = is_right_ && result;
  }

  LateKernel kernel_;
  bool waits_;
  DeviceTwins<LateTrouble> twins_;
  DeviceFrame frame_;
  std::uint32_t turn_ = 0;
  bool is_right_ = true;
};

class LateKernelOnTheDevice : public ::testing::TestWithParam<LateKernel> {
  ForAnyDevice any_;
};

NOT_IN(sanitizers, "takes long, in kernels and their compiler");
TEST_P(LateKernelOnTheDevice, RunsInSmallWorkGroups) {
  for (const bool sets : {false, true}) {
    for (const bool waits : {false, true}) {
      SCOPED_TRACE(std::string(sets ? "sets" : "worlds") + (waits ? ", waited for" : ", enqueued"));
      const LimitedDevices limited(gpu_that_limits(GetParam(), sets == waits ? 16 : 1));
      const CallersQueue queue;
      LateDeviceLife life(queue, GetParam(), sets, waits);
      life.begin();
      ASSERT_EQ(limited.asked_of_kernels(), 0) << "it was built too early";
      ASSERT_TRUE(life.need(std::nullopt));
      ASSERT_TRUE(life.go_on());
      const bool is_needed = !sets || std::string_view(GetParam().algorithm) == "tiles";
      EXPECT_TRUE(limited.asked_of_kernels() > 0 || !is_needed);
    }
  }
}

/// Like expect_late_host_lives().
void expect_late_device_lives(const LateKernel& kernel, bool sets, bool waits, long most) {
  const LimitedDevices limited(gpu_that_limits(kernel, 16));
  const CallersQueue queue;
  expect_right_lives(most, [&](long first) -> std::optional<long> {
    LateDeviceLife life(queue, kernel, sets, waits);
    life.begin();
    const std::optional<long> points = life.need(first);
    return points && life.go_on() ? points : std::nullopt;
  });
}

constexpr std::array late_on_the_device{LateKernel{"brute-force", "brute_force -DGATHER=1"},
                                        LateKernel{"tiles", "tiles_fill -DWORLDS=1"},
                                        LateKernel{"tiles", "tiles_search -DWORLDS=1", 64},
                                        LateKernel{"tiles", "tiles_keys -DWORLDS=1"},
                                        LateKernel{"tiles", "fill"},
                                        LateKernel{"auto", "tiles_search -DWORLDS=1"}};
INSTANTIATE_TEST_SUITE_P(Table, LateKernelOnTheDevice, ::testing::ValuesIn(late_on_the_device),
                         name_of_late_kernel);

NOT_IN(sanitizers, "fails on purpose, also where buffers are unmapped, and takes long");
TEST(LateKernel, LosesNothingIfACallFailsMeanwhile) {
  const ForAnyDevice any;
  expect_late_host_lives(late_on_the_host[0], 6);
  expect_late_device_lives(late_on_the_device[0], false, false, 6);
  expect_late_device_lives(late_on_the_device[1], true, true, 6);
}

/// The same for all kernels, and with more calls.
class LongLateKernelOnTheHost : public LateKernelOnTheHost {};
TEST_P(LongLateKernelOnTheHost, LosesNothingWhicheverCallFailsMeanwhile) {
  expect_late_host_lives(GetParam(), 40);
}
INSTANTIATE_TEST_SUITE_P(Long, LongLateKernelOnTheHost, ::testing::ValuesIn(late_on_the_host),
                         name_of_late_kernel);

class LongLateKernelOnTheDevice : public LateKernelOnTheDevice {};
TEST_P(LongLateKernelOnTheDevice, LosesNothingWhicheverCallFailsMeanwhile) {
  expect_late_device_lives(GetParam(), false, false, 40);
  expect_late_device_lives(GetParam(), true, true, 40);
}
INSTANTIATE_TEST_SUITE_P(Long, LongLateKernelOnTheDevice, ::testing::ValuesIn(late_on_the_device),
                         name_of_late_kernel);

NOT_IN(all_default, "takes long, in the compiler; the kernels of a search of worlds are in it");
TEST(LateKernel, OfASearchOfTwoSetsRunsInSmallWorkGroups) {
  const ForAnyDevice any;
  std::vector<Aabb> first;
  std::vector<Aabb> second;
  for (std::uint32_t k = 0; k < 300; ++k) (k % 3 == 0 ? first : second).push_back(late_box(k));
  const Pairs expected = overlapping_pairs(first, second, {.algorithm = "oracle"});
  for (const char* name : {"tiles_search -DWORLDS=1", "tiles_world_keys -DWORLDS=1"}) {
    for (const std::size_t most : {16U, 1U}) {
      const LimitedDevices limited(gpu_that_limits({"tiles", name}, most));
      EXPECT_TRUE(same(name, overlapping_pairs(first, second, {.algorithm = "tiles"}), expected));
      EXPECT_GT(limited.asked_of_kernels(), 0);
    }
  }
}

/// The environment names the tuning, or the device does not run the kernel at all.
TEST(LateKernel, ThatCannotRunIsRefusedAndNothingIsLost) {
  const ForAnyDevice any;
  const auto expect_refusal = [](const std::string& tuning, std::size_t most, const std::string& remedy) {
    const ScopedVariable named("BROADCL_TUNING", tuning);
    const LateKernel& kernel = late_on_the_host[1];
    const LimitedDevices limited(gpu_that_limits(kernel, most));
    BroadPhase broad_phase({.algorithm = kernel.algorithm});
    for (std::uint32_t k = 0; k < 20; ++k) broad_phase.add(unit);
    EXPECT_EQ(broad_phase.update().added.size(), 190U);
    broad_phase.set_filter(3, {.world = 1});
    for (int time = 0; time < 2; ++time) {
      EXPECT_THAT(error_of([&] { (void)broad_phase.update(); }),
                  AllOf(HasSubstr("allows " + std::to_string(most)), HasSubstr(remedy)));
      EXPECT_EQ(broad_phase.pairs().size(), 190U);
    }
  };
  expect_refusal("gpu", 16, "set BROADCL_TUNING=cpu");
  expect_refusal("", 0, "use another device");
}

}  // namespace
}  // namespace broadcl::test
