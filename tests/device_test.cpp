#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/device.hpp>

#include "cli/default_device.hpp"
#include "device_limits.hpp"
#include "environment.hpp"
#include "expect_error.hpp"
#include "failing_opencl.hpp"
#include "opencl/devices.hpp"

namespace broadcl {
namespace {

using ::testing::HasSubstr;

TEST(Devices, TheEnvironmentReplacesAnEmptySelector) {
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

TEST(Devices, SayWhichCardTheyAre) {
  constexpr cl_device_info khr_bus = 0x410f;
  constexpr cl_device_info nv_bus = 0x4008;
  constexpr cl_device_info nv_slot = 0x4009;
  constexpr cl_device_info nv_domain = 0x400a;
  constexpr cl_device_info amd_topology = 0x4037;
  constexpr cl_device_info khr_uuid = 0x106a;
  using test::answer;
  const auto first = [](std::map<cl_device_info, std::string> answers, const std::string& extensions) {
    answers.emplace(CL_DEVICE_EXTENSIONS, extensions + '\0');
    const test::LimitedDevices limited({.answers = answers});
    return devices().front();
  };
  const auto khr = answer(std::array<cl_uint, 4>{0x1, 0x3b, 0x1f, 7});
  EXPECT_EQ(first({{khr_bus, khr}}, "cl_khr_pci_bus_info").pci_address, "0001:3b:1f.7");
  EXPECT_EQ(first({{khr_bus, khr}}, "").pci_address, "") << "nothing is asked without the extension";
  std::map<cl_device_info, std::string> nv{{nv_bus, answer(cl_uint{0xc1})}, {nv_slot, answer(cl_uint{0x9})}};
  EXPECT_EQ(first(nv, "cl_nv_device_attribute_query").pci_address, "0000:c1:01.1");
  nv.emplace(nv_domain, answer(cl_uint{0x12}));
  EXPECT_EQ(first(nv, "cl_nv_device_attribute_query").pci_address, "0012:c1:01.1");
  std::array<cl_uchar, 24> topology{1};  // PCIe; the last three bytes are the address
  std::ranges::copy(std::array<cl_uchar, 3>{0x83, 2, 1}, topology.end() - 3);
  const std::string amd = "cl_amd_device_attribute_query";
  EXPECT_EQ(first({{amd_topology, answer(topology)}}, amd).pci_address, "0000:83:02.1");
  topology.front() = 2;
  EXPECT_EQ(first({{amd_topology, answer(topology)}}, amd).pci_address, "") << "not on the PCI bus";
  std::array<cl_uchar, 16> uuid{};
  uuid[1] = 0x5a;
  EXPECT_EQ(first({{khr_uuid, answer(uuid)}}, "cl_khr_device_uuid").uuid, "005a0000000000000000000000000000");
}

TEST(Devices, OfOneCardAreAllListedAndOneIsTheDefault) {
  const test::ScopedVariable none("BROADCL_DEVICE", "");
  const std::size_t found = devices().size();
  const test::LimitedDevices limited(
      {.is_offered_twice = true,
       .answers = {{CL_DEVICE_TYPE, test::answer(cl_device_type{CL_DEVICE_TYPE_GPU})}}});
  const std::vector<Device> listed = devices();
  ASSERT_EQ(listed.size(), 2 * found);
  const Device& again = listed[found];
  EXPECT_TRUE(cli::is_same_card(listed.front(), again)) << "by name and memory";
  EXPECT_EQ(select_device("", {listed.front(), again}).id(), listed.front().id());
  EXPECT_THAT(cli::reason_for_default(listed), HasSubstr(" is the same card with another driver"));
  EXPECT_NO_THROW((void)opencl::open(again));
}

/// The text of the Error that a function throws, if any.
template <class Function>
std::string error_if_any(const Function& function) {
  try {
    function();
  } catch (const Error& error) {
    return error.what();
  }
  return {};
}

/// Makes each OpenCL call of a function fail, alone and together with all later ones. The function must throw
/// an Error or report one.
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
  // If no device is left, the error is that of one that failed.
  const test::FailingOpenCl failing(1, 1'000'000);
  EXPECT_THAT(test::error_of([] { (void)select_device(); }), HasSubstr("CL_OUT_OF_RESOURCES"));
}

}  // namespace
}  // namespace broadcl
