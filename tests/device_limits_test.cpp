#include "device_limits.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <span>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/device.hpp>

#include "callers_queue.hpp"
#include "each_algorithm.hpp"
#include "environment.hpp"
#include "expect_error.hpp"
#include "opencl/arithmetic.hpp"
#include "opencl/common_program.hpp"
#include "opencl/context.hpp"
#include "patience.hpp"
#include "runs.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

std::vector<Aabb> copy(std::span<const Aabb> boxes) {
  return {boxes.begin(), boxes.end()};
}

/// Static scenes of every kind, and moving boxes in several worlds: first all of them move, then a few.
void expect_right_pairs(const std::string& algorithm) {
  BroadPhase broad_phase({.algorithm = algorithm});
  const auto expect_pairs_of = [&](const std::vector<Aabb>& boxes, const std::string& what) {
    EXPECT_TRUE(
        same(what.c_str(), broad_phase.pairs(), overlapping_pairs(boxes, {}, {.algorithm = "oracle"})));
  };
  for (const scenes::BoxScene& scene : scenes::box_scenes(150)) {
    std::ranges::copy(scene.boxes, broad_phase.map(scene.boxes.size()).begin());
    (void)broad_phase.update();
    expect_pairs_of(scene.boxes, scene.name);
  }
  scenes::MovingBoxes moving(3000, scenes::MovingBoxes::Sizes::mixed);
  for (int frame = 0; frame < 3; ++frame) {
    std::ranges::copy(moving.boxes(), broad_phase.map(3000).begin());
    (void)broad_phase.update();
    expect_pairs_of(copy(moving.boxes()), "all moved");
    moving.advance();
  }
  std::vector<Aabb> boxes = copy(moving.boxes());
  std::ranges::copy(boxes, broad_phase.map(boxes.size()).begin());
  (void)broad_phase.update();
  for (std::uint32_t id = 0; id < 100; ++id) {
    boxes[id] = boxes[id + 100];
    broad_phase.move(id, boxes[id]);
  }
  (void)broad_phase.update();
  expect_pairs_of(boxes, "few moved");
  const Pairs all = broad_phase.pairs();
  for (std::uint32_t id = 0; id < boxes.size(); ++id) broad_phase.set_filter(id, {.world = id % 2});
  (void)broad_phase.update();
  Pairs of_one_world;
  std::ranges::copy_if(all, std::back_inserter(of_one_world),
                       [](const Pair& pair) { return pair.a % 2 == pair.b % 2; });
  EXPECT_TRUE(same("two worlds", broad_phase.pairs(), of_one_world));
}

class OnLimitedDevice : public ::testing::TestWithParam<std::string> {};

NOT_IN(sanitizers, "takes long, in kernels only");
TEST_P(OnLimitedDevice, SmallWorkGroupsFindWhatTheOracleFinds) {
  for (const std::size_t most : {64U, 16U, 1U}) {
    SCOPED_TRACE(most);
    const LimitedDevices limited({.work_group = most, .local_memory = 16 << 10});
    expect_right_pairs(GetParam());
  }
}

NOT_IN(sanitizers, "takes long, in kernels only");
TEST_P(OnLimitedDevice, SmallBuffersPlainQueuesOrNoDenormalsFindWhatTheOracleFinds) {
  const ScopedVariable cache("BROADCL_CACHE_DIR", "/dev/null");
  const std::vector<Limits> each{
      {.allocation = 128 << 20}, {.queue_properties = 0}, {.has_denormals = false}};
  for (const Limits& limits : each) {
    SCOPED_TRACE(&limits - each.data());
    const LimitedDevices limited(limits);
    expect_right_pairs(GetParam());
  }
}

/// Boxes whose bounds are denormal numbers and their neighbours: some overlap, some touch, some are empty.
std::vector<Aabb> small_boxes() {
  constexpr float step = std::numeric_limits<float>::denorm_min();
  const std::array bounds{-3 * step, -step, -0.0F, 0.0F, step, 2 * step, std::numeric_limits<float>::min(),
                          1.0F};
  std::vector<Aabb> boxes;
  for (const float lower : bounds) {
    for (const float upper : bounds) {
      boxes.push_back({{lower, 0, 0}, {upper, step, 1}});
      boxes.push_back({{0, lower, step}, {step, upper, step}});
      boxes.push_back({{-1, -1, lower}, {1, 1, upper}});
    }
  }
  return boxes;
}

void expect_right_small_pairs(const std::string& algorithm) {
  const std::vector<Aabb> boxes = small_boxes();
  EXPECT_TRUE(same("small", overlapping_pairs(boxes, {}, {.algorithm = algorithm}),
                   overlapping_pairs(boxes, {}, {.algorithm = "oracle"})));
}

ALSO_IN(gpu_profile | rusticl | oclgrind);
TEST_P(OnLimitedDevice, DenormalNumbersAreNotZeros) {
  expect_right_small_pairs(GetParam());
}

ALSO_IN(gpu_profile);
TEST_P(OnLimitedDevice, DenormalNumbersAreNotZerosEvenIfTheDeviceTakesThemForThat) {
  const LimitedDevices limited({.has_denormals = false});
  const ScopedVariable cache("BROADCL_CACHE_DIR", "/dev/null");
  expect_right_small_pairs(GetParam());
}

INSTANTIATE_TEST_SUITE_P(Device, OnLimitedDevice, ::testing::Values("brute-force", "tiles", "gpu-bf"),
                         named_by_parameter);

/// Chooses the tuning by what the device reports, whatever the environment says.
class LimitedDevice : public ::testing::Test {
  ScopedVariable tuning_{"BROADCL_TUNING", ""};
};
SUITE_ALSO_IN(LimitedDevice, kernels);

TEST_F(LimitedDevice, WithSmallWorkGroupsOrLittleLocalMemoryGetsTheTuningProfileForCpus) {
  for (const Limits& limits : {Limits{.work_group = 128}, Limits{.local_memory = 16 << 10}}) {
    const LimitedDevices limited(limits);
    EXPECT_EQ(opencl::Context(select_device(), false).tuning(), opencl::Tuning::cpu);
  }
}

/// A GPU whose extensions or kernels report this number of work-items that run in lockstep.
Limits gpu_of(const char* extensions, cl_uint name, const std::string& width) {
  return {.answers = {{CL_DEVICE_TYPE, answer(cl_device_type{CL_DEVICE_TYPE_GPU})},
                      {CL_DEVICE_EXTENSIONS, std::string(extensions) + '\0'},
                      {name, width}}};
}

constexpr cl_uint multiple = CL_KERNEL_PREFERRED_WORK_GROUP_SIZE_MULTIPLE;

TEST_F(LimitedDevice, WithWavesOf64GetsATuningProfileOfItsOwn) {
  const ScopedVariable any("BROADCL_DEVICE", "");
  const auto tuning_of = [](const Limits& limits) {
    const LimitedDevices limited(limits);
    return opencl::Context(select_device(), false).tuning();
  };
  const auto say = [](cl_uint width) { return answer(width); };
  const auto multiple_of = [](std::size_t width) { return gpu_of("", multiple, answer(width)); };
  const char* const amd = "cl_khr_fp64 cl_amd_device_attribute_query";
  const char* const nvidia = "cl_nv_device_attribute_query";
  EXPECT_EQ(tuning_of(gpu_of(amd, wavefront_width_of_amd, say(64))), opencl::Tuning::gpu64);
  EXPECT_EQ(tuning_of(gpu_of(amd, wavefront_width_of_amd, say(32))), opencl::Tuning::gpu);
  EXPECT_EQ(tuning_of(gpu_of(nvidia, warp_size_of_nvidia, say(32))), opencl::Tuning::gpu);
  EXPECT_EQ(tuning_of(multiple_of(64)), opencl::Tuning::gpu64);
  for (const std::size_t width : {1U, 16U, 32U, 128U}) {
    EXPECT_EQ(tuning_of(multiple_of(width)), opencl::Tuning::gpu) << width;
  }
  Limits embedded = multiple_of(64);
  embedded.answers[CL_DEVICE_PROFILE] = std::string("EMBEDDED_PROFILE") + '\0';
  EXPECT_EQ(tuning_of(embedded), opencl::Tuning::gpu);
  Limits cpu = multiple_of(64);
  cpu.answers[CL_DEVICE_TYPE] = answer(cl_device_type{CL_DEVICE_TYPE_CPU});
  EXPECT_EQ(tuning_of(cpu), opencl::Tuning::cpu);
}

ALSO_IN(gpu_profile);
NOT_IN(all_default | sanitizers, "takes long, in kernels and their compiler");
TEST_F(LimitedDevice, WithWavesOf64FindsWhatTheOracleFinds) {
  const LimitedDevices limited(gpu_with_waves_of(64));
  ASSERT_EQ(opencl::Context(select_device(), false).tuning(), opencl::Tuning::gpu64);
  expect_right_pairs("tiles");
  // Enough boxes that the tree has another level, but too many for the oracle.
  const scenes::MovingBoxes many(50'000, scenes::MovingBoxes::Sizes::mixed);
  EXPECT_TRUE(same("many", overlapping_pairs(many.boxes(), {}, {.algorithm = "tiles"}),
                   overlapping_pairs(many.boxes(), {}, {.algorithm = "sweep-and-prune"})));
}

/// For instance, a GPU with few registers.
TEST_F(LimitedDevice, ThatRunsKernelsInSmallWorkGroupsOnlyGetsSuchOnes) {
  const ScopedVariable any("BROADCL_DEVICE", "");
  const std::vector<Aabb> boxes(50, unit);
  const auto expect_all_pairs = [&](const std::string& algorithm,
                                    const std::map<std::string, std::size_t>& kernels) {
    SCOPED_TRACE(algorithm + ", " + kernels.begin()->first);
    Limits gpu = gpu_with_waves_of(32);
    gpu.work_group_of_kernel = kernels;
    const LimitedDevices limited(gpu);
    ASSERT_EQ(opencl::Context(select_device(), false).tuning(), opencl::Tuning::gpu);
    const Config config{.device = select_device().id(), .algorithm = algorithm};
    EXPECT_EQ(overlapping_pairs(boxes, {}, config).size(), 1225U);
    if (algorithm == "gpu-bf") return;
    const CallersQueue queue;
    DeviceBroadPhase on_device(queue(), {.algorithm = algorithm});
    EXPECT_EQ(on_device.update({.buffer = queue.buffer_of(boxes)(), .count = 50}).pair_count, 1225U);
  };
  expect_all_pairs("tiles", {{"radix_sort_scatter", 128}, {"tiles_keys", 8}});
  for (const char* kernel : {"tiles_fill", "tiles_refit_and_keep", "tiles_search"}) {
    expect_all_pairs("tiles", {{kernel, 16}});
  }
  expect_all_pairs("brute-force", {{"brute_force", 1}});
  expect_all_pairs("auto", {{"order_small", 64}});
  expect_all_pairs("gpu-bf", {{"gpu_bf", 1}});
}

TEST_F(LimitedDevice, ThatRunsNoKernelAtAllIsRefused) {
  const LimitedDevices limited({.work_group_of_kernel = {{"tiles_keys", 0}}});
  EXPECT_THAT(error_of([] { BroadPhase({.algorithm = "tiles"}); }),
              HasSubstr("allows 0; use another device"));
}

TEST_F(LimitedDevice, OfRusticlIsBelievedExceptVersion22) {
  const ScopedVariable any("BROADCL_DEVICE", "");
  const auto group_of = [](const std::string& driver) {
    const LimitedDevices limited(
        {.work_group_of_kernel = {{"fill", 16}},
         .answers = {{CL_PLATFORM_NAME, std::string("rusticl") + '\0'}, {CL_DRIVER_VERSION, driver + '\0'}}});
    const opencl::Context context(select_device(), false);
    return context.sized_kernel(context.program("fill.cl"), "fill").group;
  };
  EXPECT_GT(group_of("22.3.6"), 16U);
  EXPECT_EQ(group_of("25.0.7-2"), 16U);
}

TEST_F(LimitedDevice, ThatCannotRunAKernelSaysSoAtOnce) {
  const LimitedDevices limited({.work_group = 64});
  const ScopedVariable tuning("BROADCL_TUNING", "gpu");
  EXPECT_THAT(error_of([] { BroadPhase({.algorithm = "tiles"}); }),
              AllOf(HasSubstr("256"), HasSubstr("allows 64"), HasSubstr("BROADCL_TUNING=cpu")));
}

/// Whether the implementation reports how much local memory a kernel needs; PoCL 6.0 always says 0.
bool tells_local_memory() {
  const opencl::Context context(select_device(), false);
  const cl::Kernel kernel =
      context.kernel(opencl::common_program(context), "order_small", context.launch().group);
  const cl::Device device(context.queue().getInfo<CL_QUEUE_DEVICE>());
  return kernel.getWorkGroupInfo<CL_KERNEL_LOCAL_MEM_SIZE>(device) > 0;
}

/// (The minimum that OpenCL's embedded profile requires is enough for gpu-bf.)
TEST_F(LimitedDevice, WithTooLittleLocalMemorySaysSoAtOnce) {
  const bool is_told = tells_local_memory();
  const LimitedDevices limited({.local_memory = 1 << 10});
  if (!is_told) {  // nothing can be refused
    EXPECT_EQ(overlapping_pairs(std::vector<Aabb>(50, unit), {}, {.algorithm = "brute-force"}).size(), 1225U);
    return;
  }
  EXPECT_THAT(error_of([] { BroadPhase({.algorithm = "brute-force"}); }),
              HasSubstr("bytes of local memory, but the device has 1024; use another device"));
  EXPECT_EQ(overlapping_pairs(std::vector<Aabb>(50, unit), {}, {.algorithm = "gpu-bf"}).size(), 1225U);
  const ScopedVariable tuning("BROADCL_TUNING", "gpu");
  EXPECT_THAT(error_of([] { BroadPhase({.algorithm = "tiles"}); }),
              AllOf(HasSubstr("bytes of local memory"), HasSubstr("set BROADCL_TUNING=cpu")));
}

TEST_F(LimitedDevice, WithSmallAllocationsRefusesPairsThatDoNotFitAndGoesOn) {
  const LimitedDevices limited({.allocation = 1 << 20});
  BroadPhase broad_phase({.algorithm = "brute-force"});
  for (std::uint32_t k = 0; k < 300; ++k) broad_phase.add(unit);
  EXPECT_EQ(broad_phase.update().added.size(), 300U * 299 / 2);
  for (std::uint32_t k = 0; k < 700; ++k) broad_phase.add(unit);
  EXPECT_THAT(error_of([&] { (void)broad_phase.update(); }), HasSubstr("overlapping pairs"));
  EXPECT_EQ(broad_phase.pairs().size(), 300U * 299 / 2);
  for (std::uint32_t id = 300; id < 1000; ++id) broad_phase.remove(id);
  EXPECT_TRUE(broad_phase.update().added.empty());
}

TEST_F(LimitedDevice, WithSmallAllocationsHasATreeForAllBoxesThatFit) {
  const LimitedDevices limited({.allocation = 1 << 20});
  constexpr std::uint32_t n = 40'000;
  BroadPhase broad_phase({.algorithm = "tiles"});
  const std::span<Aabb> boxes = broad_phase.map(n);
  for (std::uint32_t k = 0; k < n; ++k) boxes[k] = apart(k);
  boxes[n - 1] = boxes[0];
  EXPECT_TRUE(same("added", broad_phase.update().added, Pairs{{0, n - 1}}));
}

/// Changes that fit in lists of their number, but not in one of a quarter more.
TEST_F(LimitedDevice, WithSmallAllocationsHasListsForAllChangesThatFit) {
  const LimitedDevices limited({.allocation = 1 << 20});
  constexpr std::size_t n = 375;
  std::vector<Aabb> boxes(n, unit);
  for (std::size_t k = 0; k < n; ++k) boxes.push_back(apart(1 + k));
  const CallersQueue queue;
  const cl::Buffer first_together = queue.buffer_of(boxes);
  std::rotate(boxes.begin(), boxes.begin() + n, boxes.end());
  const cl::Buffer second_together = queue.buffer_of(boxes);
  DeviceBroadPhase broad_phase(queue(), {.algorithm = "brute-force"});
  (void)broad_phase.update({.buffer = first_together(), .count = 2 * n});
  for (const cl::Buffer& now : {second_together, first_together, second_together}) {
    const auto result = broad_phase.update({.buffer = now(), .count = 2 * n});
    EXPECT_EQ(result.added.count, n * (n - 1) / 2);
    EXPECT_EQ(result.removed.count, n * (n - 1) / 2);
  }
}

/// On Intel's GPUs, large buffers need a flag and an option, which only gpu-bf uses.
NOT_IN(all_default, "takes long, in the compiler");
TEST_F(LimitedDevice, OfIntelHasLargeBuffersForGpuBf) {
  const ScopedVariable any("BROADCL_DEVICE", "");
  const ScopedVariable cache("BROADCL_CACHE_DIR", "/dev/null");
  const Limits small{.allocation = 1 << 20};
  Limits intel{.allocation = 1 << 20,
               .has_large_buffers = true,
               .answers = {{CL_PLATFORM_NAME, std::string("Intel(R) OpenCL Graphics") + '\0'},
                           {CL_DEVICE_TYPE, answer(cl_device_type{CL_DEVICE_TYPE_GPU})}}};
  const std::vector<Aabb> boxes(2000, unit);
  const auto pairs_of = [&](const Limits& limits, const std::string& algorithm) {
    const LimitedDevices limited(limits);
    return overlapping_pairs(boxes, {}, {.algorithm = algorithm}).size();
  };
  EXPECT_EQ(pairs_of(intel, "gpu-bf"), 2000U * 1999 / 2);
  Limits in_small_groups = intel;  // the kernel for large buffers, too
  in_small_groups.work_group_of_kernel = {{"gpu_bf", 16}};
  EXPECT_EQ(pairs_of(in_small_groups, "gpu-bf"), 2000U * 1999 / 2);
  EXPECT_THAT(error_of([&] { (void)pairs_of(intel, "brute-force"); }),
              HasSubstr("allocates at most 1048576"));
  EXPECT_THAT(error_of([&] { (void)pairs_of(small, "gpu-bf"); }), HasSubstr("allocates at most 1048576"));
  intel.answers.emplace(CL_DEVICE_GLOBAL_MEM_SIZE, answer(cl_ulong{1 << 19}));
  EXPECT_THAT(error_of([&] { (void)pairs_of(intel, "gpu-bf"); }), HasSubstr("allocates at most 524288"));
}

TEST_F(LimitedDevice, WithoutProfilingRefusesItAtOnce) {
  const LimitedDevices limited({.queue_properties = 0});
  EXPECT_THAT(error_of([] { BroadPhase({.algorithm = "brute-force", .profile = true}); }),
              HasSubstr("profil"));
  BroadPhase broad_phase({.algorithm = "brute-force"});
  broad_phase.add(unit);
  broad_phase.add(unit);
  EXPECT_EQ(broad_phase.update().added.size(), 1U);
}

NOT_IN(rusticl, "-cl-denorms-are-zero changes nothing there");
TEST_F(LimitedDevice, WithoutDenormalNumbersIsRecognised) {
  const ScopedVariable cache("BROADCL_CACHE_DIR", "/dev/null");
  EXPECT_FALSE(opencl::flushes_denormals(opencl::Context(select_device(), false)));
  const LimitedDevices limited({.has_denormals = false});
  EXPECT_TRUE(opencl::flushes_denormals(opencl::Context(select_device(), false)));
}

TEST_F(LimitedDevice, WithoutACompilerIsNotUsed) {
  const LimitedDevices limited({.has_compiler = false});
  std::vector<std::string> failures;
  EXPECT_TRUE(devices(&failures).empty());
  EXPECT_THAT(failures, ::testing::Contains(HasSubstr("compiler")));
}

/// What PoCL does if it has no folder for its cache, and rusticl unless it is enabled.
TEST_F(LimitedDevice, ThatIsNotOfferedLeavesTheDriverToBeNamed) {
  const ScopedVariable any("BROADCL_DEVICE", "");
  const auto error_with = [](const std::string& platform, const std::string& selector) {
    const LimitedDevices limited({.has_devices = false, .answers = {{CL_PLATFORM_NAME, platform + '\0'}}});
    EXPECT_TRUE(devices().empty());
    return error_of([&] { (void)select_device(selector); });
  };
  for (const std::string selector : {"", "gpu"}) {
    EXPECT_THAT(error_with("Portable Computing Language", selector),
                AllOf(HasSubstr("although drivers are installed: Portable Computing Language"),
                      HasSubstr("; PoCL shows none"), HasSubstr("POCL_CACHE_DIR"),
                      Not(HasSubstr("RUSTICL_ENABLE")), Not(HasSubstr("apt install"))));
    EXPECT_THAT(error_with("rusticl", selector),
                AllOf(HasSubstr("RUSTICL_ENABLE"), HasSubstr("apt install pocl")));
    EXPECT_THAT(error_with("Some", selector),
                AllOf(HasSubstr("although drivers are installed: Some"), HasSubstr("; check that"),
                      HasSubstr("apt install pocl")));
  }
}

/// The errors of updates in which many boxes move, until one fails or there were enough of them, and then of
/// a few more.
std::vector<std::string> errors_of_updates(BroadPhase& broad_phase, int most_updates) {
  constexpr std::uint32_t n = 20'000;
  std::vector<std::string> errors;
  const auto start = std::chrono::steady_clock::now();
  int rest = 20;
  for (int k = 0; rest > 0 && std::chrono::steady_clock::now() - start < patience; ++k) {
    const std::span<Aabb> boxes = broad_phase.map(n);
    for (std::uint32_t id = 0; id < n; ++id)
      boxes[id] = apart((id + static_cast<std::uint32_t>(k)) % (n - 1));
    try {
      (void)broad_phase.update();
    } catch (const Error& error) {
      errors.emplace_back(error.what());
    }
    EXPECT_EQ(broad_phase.pairs().size(), 1U) << k;
    if (!errors.empty() || k >= most_updates) --rest;
  }
  return errors;
}

/// A GPU that rejects a kernel. It is opened in another thread, at some time.
NOT_IN(gpu_profile | rusticl | sanitizers, "takes long");
TEST_F(LimitedDevice, ThatAutoCannotOpenIsAnErrorOnceIfItIsNamed) {
  const ScopedVariable none("BROADCL_DEVICE", "");
  Limits gpu = gpu_with_waves_of(32);
  gpu.work_group_of_kernel = {{"tiles_keys", 0}};
  const LimitedDevices limited(gpu);
  BroadPhase named({.device = "gpu"});
  EXPECT_THAT(errors_of_updates(named, std::numeric_limits<int>::max()), ElementsAre(HasSubstr("allows 0")));
  BroadPhase not_named;
  EXPECT_THAT(errors_of_updates(not_named, 500), IsEmpty());
}

}  // namespace
}  // namespace broadcl::test
