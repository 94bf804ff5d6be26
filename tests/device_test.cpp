#include <algorithm>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/device.hpp>

#include "environment.hpp"
#include "expect_error.hpp"
#include "failing_opencl.hpp"
#include "opencl/devices.hpp"

namespace broadcl {
namespace {

using ::testing::HasSubstr;

Device make(unsigned platform, unsigned index, DeviceType type, const char* platform_name, const char* name,
            unsigned compute_units) {
  return {.platform = platform,
          .index = index,
          .type = type,
          .platform_name = platform_name,
          .name = name,
          .version = "OpenCL 1.2",
          .driver_version = "1",
          .compute_units = compute_units,
          .clock_mhz = 1000,
          .memory = 1 << 30,
          .max_allocation = 1 << 28,
          .host_unified = false,
          .vendor_id = 0};
}

/// A graphics card, or one in a processor.
Device gpu(const char* name, std::uint32_t vendor_id, unsigned compute_units, unsigned clock_mhz,
           bool host_unified) {
  Device device = make(0, 0, DeviceType::gpu, "Some", name, compute_units);
  device.vendor_id = vendor_id;
  device.clock_mhz = clock_mhz;
  device.host_unified = host_unified;
  return device;
}
const Device iris = gpu("Iris Xe", 0x8086, 96, 1300, true);
const Device uhd = gpu("UHD Graphics", 0x8086, 32, 1500, true);
const Device radeon = gpu("Radeon RX 7900 XTX", 0x1002, 48, 2300, false);
const Device arc = gpu("Arc A770", 0x8086, 512, 2400, false);
const Device geforce = gpu("GeForce RTX 4090", 0x10de, 128, 2520, false);

const std::vector<Device>& machine() {
  static const std::vector<Device> devices{
      make(0, 0, DeviceType::cpu, "Portable Computing Language", "pthread-EPYC", 16),
      make(2, 0, DeviceType::gpu, "Intel(R) OpenCL", "UHD Graphics", 24),
      make(2, 1, DeviceType::accelerator, "Intel(R) OpenCL", "FPGA Board", 1),
      make(11, 0, DeviceType::gpu, "NVIDIA CUDA", "NVIDIA H200", 132),
  };
  return devices;
}

TEST(SelectDevice, AnEmptySelectorTakesTheBestGpuOtherwiseACpu) {
  EXPECT_EQ(select_device("", machine()).name, "NVIDIA H200");
  EXPECT_EQ(select_device("", {machine()[2], machine()[0]}).name, "pthread-EPYC");
  EXPECT_EQ(select_device("", {machine()[2]}).name, "FPGA Board");
}

TEST(SelectDevice, TheBestGpuHasItsOwnMemoryThenTheMostArithmeticUnits) {
  const auto best = [](std::vector<Device> among) {
    const std::string name = select_device("", among).name;
    std::ranges::reverse(among);
    EXPECT_EQ(select_device("", among).name, name) << "in another order";
    return name;
  };
  EXPECT_EQ(best({iris, radeon}), radeon.name) << "fewer and larger units";
  EXPECT_EQ(best({iris, uhd}), iris.name);
  EXPECT_EQ(best({arc, geforce, iris}), geforce.name);
  EXPECT_EQ(best({arc, uhd, machine()[0]}), arc.name);
}

TEST(SelectDevice, TheDefaultHasAReason) {
  const test::ScopedVariable none("BROADCL_DEVICE", "");
  EXPECT_EQ(reason_for_default({iris}), "it is the only device");
  EXPECT_EQ(reason_for_default({iris, machine()[0]}), "it is the only GPU");
  EXPECT_EQ(reason_for_default({iris, radeon}), "it is the only GPU with memory of its own");
  EXPECT_EQ(reason_for_default({iris, radeon, geforce}),
            "it has the most arithmetic units times clock frequency of the GPUs with memory of their own");
  EXPECT_EQ(reason_for_default({iris, uhd}),
            "it has the most arithmetic units times clock frequency of the GPUs");
  EXPECT_EQ(reason_for_default({machine()[0], machine()[2]}), "there is no GPU, and it is the only CPU");
  const test::ScopedVariable named("BROADCL_DEVICE", "gpu");
  EXPECT_EQ(reason_for_default({iris, radeon}), "BROADCL_DEVICE is 'gpu'");
}

TEST(SelectDevice, ByNumbers) {
  EXPECT_EQ(select_device("2:1", machine()).name, "FPGA Board");
  EXPECT_EQ(select_device("11:0", machine()).name, "NVIDIA H200");
  EXPECT_THROW((void)select_device("1:0", machine()), Error) << "not a part of 11:0";
}

TEST(SelectDevice, ByType) {
  EXPECT_EQ(select_device("gpu", machine()).name, "NVIDIA H200");
  EXPECT_EQ(select_device("CPU", machine()).name, "pthread-EPYC");
  EXPECT_EQ(select_device("accelerator", machine()).name, "FPGA Board");
  EXPECT_THROW((void)select_device("accelerator", {machine()[0]}), Error);
}

TEST(SelectDevice, ByAPartOfItsLabelInAnyCase) {
  EXPECT_EQ(select_device("h200", machine()).name, "NVIDIA H200");
  EXPECT_EQ(select_device("portable", machine()).name, "pthread-EPYC");
  EXPECT_EQ(select_device("OpenCL / uhd", machine()).name, "UHD Graphics");
  EXPECT_EQ(select_device("intel(r)", machine()).name, "UHD Graphics") << "the best of several";
}

TEST(SelectDevice, AnUnknownDeviceIsAnErrorThatListsTheDevices) {
  const std::string text = test::error_of([] { (void)select_device("radeon", machine()); });
  EXPECT_THAT(text, HasSubstr("'radeon'"));
  for (const Device& device : machine()) {
    EXPECT_THAT(text, HasSubstr(device.id() + " (" + device.label() + ")"));
  }
}

TEST(SelectDevice, NoDeviceAtAllSaysWhatToInstall) {
  EXPECT_THAT(test::error_of([] { (void)select_device("", {}); }), HasSubstr("pocl-opencl-icd"));
}

TEST(SelectDevice, TheEnvironmentReplacesAnEmptySelector) {
  const test::ScopedVariable variable("BROADCL_DEVICE", "no such device");
  EXPECT_THAT(test::error_of([] { (void)select_device(); }), HasSubstr("'no such device'"));
  EXPECT_NO_THROW((void)select_device(devices().front().id()));
}

TEST(Devices, EachCanBeSelectedByItsId) {
  ASSERT_FALSE(devices().empty());
  for (const Device& device : devices()) {
    EXPECT_EQ(select_device(device.id()).label(), device.label());
    EXPECT_GT(device.max_allocation, 0U);
    EXPECT_GT(device.compute_units, 0U);
  }
}

/// The text of the Error that a function throws, if it does.
template <class Function>
std::string error_if_any(const Function& function) {
  try {
    function();
  } catch (const Error& error) {
    return error.what();
  }
  return {};
}

/// Makes each OpenCL call of a function fail, alone and together with all later ones. Then it throws an
/// Error, or tells of one.
template <class Function>
void expect_errors(const Function& function) {
  constexpr long all = 1'000'000;
  long calls = 0;
  {
    const test::FailingOpenCl none(all, 0);
    std::vector<std::string> failures;
    function(failures);
    EXPECT_TRUE(failures.empty());
    calls = test::FailingOpenCl::calls();
  }
  EXPECT_GT(calls, 1);
  for (const long count : {1L, all}) {
    for (long first = 0; first < calls; ++first) {
      const test::FailingOpenCl failing(first, count);
      std::vector<std::string> failures;
      const std::string error = error_if_any([&] { function(failures); });
      EXPECT_THAT(error.empty() && !failures.empty() ? failures.front() : error,
                  HasSubstr("CL_OUT_OF_RESOURCES"))
          << "call " << first;
    }
  }
}

TEST(Devices, EveryCallThatFailsIsAnError) {
  const Device device = select_device();
  const cl::Device opened = opencl::open(device);
  const cl::Context context(opened);
  const cl::CommandQueue queue(context, opened);
  expect_errors([](std::vector<std::string>& failures) { (void)devices(&failures); });
  expect_errors([&](std::vector<std::string>& /*failures*/) { (void)opencl::open(device); });
  expect_errors([&](std::vector<std::string>& /*failures*/) { (void)opencl::describe(queue); });
}

/// A failing call costs one platform or device, not the others.
TEST(Devices, ThatFailDoNotHideOthers) {
  const std::size_t most = devices().size();
  const long calls = [] {
    const test::FailingOpenCl none(1'000'000, 0);
    (void)devices();
    return test::FailingOpenCl::calls();
  }();
  for (long first = 1; first < calls; ++first) {  // after the one for the list of platforms
    const test::FailingOpenCl failing(first, 1);
    std::vector<std::string> failures;
    std::size_t found = 0;
    if (error_if_any([&] { found = devices(&failures).size(); }).empty()) {
      EXPECT_LT(found, most + 1);
      EXPECT_EQ(failures.size(), 1U);
    }
  }
  // If none is left, the error is that of one that failed.
  const test::FailingOpenCl failing(1, 1'000'000);
  EXPECT_THAT(test::error_of([] { (void)select_device(); }), HasSubstr("CL_OUT_OF_RESOURCES"));
}

}  // namespace
}  // namespace broadcl
