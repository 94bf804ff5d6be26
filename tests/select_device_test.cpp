#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/device.hpp>
#include <broadcl/error.hpp>

#include "cli/default_device.hpp"
#include "environment.hpp"
#include "expect_error.hpp"

namespace broadcl {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

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

/// A discrete GPU, or one in a processor.
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
    std::string name = select_device("", among).name;
    std::ranges::reverse(among);
    EXPECT_EQ(select_device("", among).name, name) << "must not depend on the order";
    return name;
  };
  EXPECT_EQ(best({iris, radeon}), radeon.name) << "fewer and larger units";
  EXPECT_EQ(best({iris, uhd}), iris.name);
  EXPECT_EQ(best({arc, geforce, iris}), geforce.name);
  EXPECT_EQ(best({arc, uhd, machine()[0]}), arc.name);
}

TEST(SelectDevice, TheDefaultHasAReason) {
  const test::ScopedVariable none("BROADCL_DEVICE", "");
  EXPECT_EQ(cli::reason_for_default({iris}), "it is the only device");
  EXPECT_EQ(cli::reason_for_default({iris, machine()[0]}), "it is the only GPU");
  EXPECT_EQ(cli::reason_for_default({iris, radeon}), "it is the only GPU with memory of its own");
  EXPECT_EQ(cli::reason_for_default({iris, radeon, geforce}),
            "it has the most arithmetic units times clock frequency of the GPUs with memory of their own");
  EXPECT_EQ(cli::reason_for_default({iris, uhd}),
            "it has the most arithmetic units times clock frequency of the GPUs");
  EXPECT_EQ(cli::reason_for_default({machine()[0], machine()[2]}), "there is no GPU, and it is the only CPU");
  const test::ScopedVariable named("BROADCL_DEVICE", "gpu");
  EXPECT_EQ(cli::reason_for_default({iris, radeon}), "BROADCL_DEVICE is 'gpu'");
}

/// The same device on another platform, which gives it another name.
Device by_another_driver(Device device) {
  ++device.platform;
  device.name += " (radeonsi, navi31)";
  device.memory -= 4096;
  return device;
}

TEST(SameCard, HasOnePciAddressOtherwiseOneUuidOtherwiseOneNameAndMemory) {
  Device card = radeon;
  Device other = by_another_driver(card);
  EXPECT_FALSE(cli::is_same_card(card, other));
  card.uuid = other.uuid = "00112233445566778899aabbccddeeff";
  EXPECT_TRUE(cli::is_same_card(card, other));
  card.pci_address = "0000:03:00.0";
  EXPECT_TRUE(cli::is_same_card(card, other));
  other.pci_address = "0000:04:00.0";
  EXPECT_FALSE(cli::is_same_card(card, other));
  other.pci_address = card.pci_address;
  EXPECT_TRUE(cli::is_same_card(card, other));
  other.uuid = "another";
  EXPECT_TRUE(cli::is_same_card(card, other));

  other = card = radeon;
  EXPECT_FALSE(cli::is_same_card(card, other)) << "two devices of one platform";
  ++other.platform;
  EXPECT_TRUE(cli::is_same_card(card, other));
  other.memory = 1;
  EXPECT_FALSE(cli::is_same_card(card, other));
  other = machine()[0];
  ++other.platform;
  EXPECT_FALSE(cli::is_same_card(machine()[0], other)) << "CPUs";
}

TEST(SameCard, CountsOnceForTheDefault) {
  const test::ScopedVariable none("BROADCL_DEVICE", "");
  Device card = radeon;
  card.pci_address = "0000:03:00.0";
  Device other = by_another_driver(card);
  EXPECT_EQ(cli::reason_for_default({card, other}),
            "it is the only device; 1:0 is the same card with another driver");
  EXPECT_EQ(select_device("", {card, other}).id(), "0:0") << "the first of equals";
  other.compute_units = 96;
  EXPECT_EQ(cli::reason_for_default({machine()[0], card, other}),
            "it is the only GPU; 0:0 is the same card with another driver");
  EXPECT_EQ(select_device("", {machine()[0], card, other}).id(), "1:0");
  EXPECT_EQ(select_device("0:0", {card, other}).id(), "0:0") << "each can be selected by its id";

  // Two cards of one kind, without an address: each counts once.
  Device second = radeon;
  second.index = 1;
  Device first_again = radeon;
  Device second_again = second;
  first_again.platform = second_again.platform = 1;
  EXPECT_THAT(cli::reason_for_default({radeon, second, first_again, second_again}),
              StartsWith("it has the most arithmetic units times clock frequency of the GPUs;"));
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

}  // namespace
}  // namespace broadcl
