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
          .host_unified = false};
}

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

/// Makes each OpenCL call of a function fail, alone and together with all later ones.
template <class Function>
void expect_errors(const Function& function) {
  constexpr long all = 1'000'000;
  long calls = 0;
  {
    const test::FailingOpenCl none(all, 0);
    function();
    calls = test::FailingOpenCl::calls();
  }
  EXPECT_GT(calls, 1);
  for (const long count : {1L, all}) {
    for (long first = 0; first < calls; ++first) {
      const test::FailingOpenCl failing(first, count);
      EXPECT_THAT(test::error_of(function), HasSubstr("CL_OUT_OF_RESOURCES")) << "call " << first;
    }
  }
}

TEST(Devices, EveryCallThatFailsIsAnError) {
  const Device device = select_device();
  const cl::Device opened = opencl::open(device);
  const cl::Context context(opened);
  const cl::CommandQueue queue(context, opened);
  expect_errors([] { (void)devices(); });
  expect_errors([&] { (void)select_device(device.id()); });
  expect_errors([&] { (void)opencl::open(device); });
  expect_errors([&] { (void)opencl::describe(queue); });
}

}  // namespace
}  // namespace broadcl
