#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <broadcl/export.h>

namespace broadcl {

enum class DeviceType { gpu, cpu, accelerator, other };

/// "gpu", "cpu", "accelerator" or "other".
[[nodiscard]] BROADCL_API std::string_view to_string(DeviceType type) noexcept;

/// What an OpenCL device reports about itself. A plain value: it holds no OpenCL object and stays valid.
struct BROADCL_API Device {
  unsigned platform;  ///< Index of its platform, as in `clinfo -l`.
  unsigned index;     ///< Index within the platform.
  DeviceType type;
  std::string platform_name;
  std::string name;
  std::string version;         ///< CL_DEVICE_VERSION, for instance "OpenCL 3.0 CUDA".
  std::string driver_version;  ///< CL_DRIVER_VERSION.
  unsigned compute_units;
  unsigned clock_mhz;            ///< Highest clock frequency, 0 if the device does not say.
  std::uint64_t memory;          ///< Global memory, bytes.
  std::uint64_t max_allocation;  ///< Largest single buffer, bytes.
  bool host_unified;             ///< Host and device share memory.
  std::uint32_t vendor_id;       ///< CL_DEVICE_VENDOR_ID: 0x10de for NVIDIA, for instance.
  std::string pci_address{};     ///< "0000:3b:00.0"; empty if the device does not say.
  std::string uuid{};            ///< CL_DEVICE_UUID_KHR, 32 hexadecimal digits; empty if there is none.

  /// "P:D", a selector for this device.
  [[nodiscard]] std::string id() const;
  /// "platform / name".
  [[nodiscard]] std::string label() const;
};

/// Every usable device of every OpenCL platform, that is, every one that is available and has a compiler, in
/// the order of `clinfo -l`. Empty if no OpenCL implementation is installed.
/// @param failures If not null, receives one line for each platform and device that cannot be used, with the
/// reason.
/// @throws Error if the loader fails; and, unless `failures` is given, if there are devices but none is
/// usable.
[[nodiscard]] BROADCL_API std::vector<Device> devices(std::vector<std::string>* failures = nullptr);

/// Picks a device.
///
/// @param selector "P:D" as numbered by `clinfo -l`; "gpu", "cpu" or "accelerator"; or a part of "platform /
/// name", ignoring case. If it is empty, the environment variable BROADCL_DEVICE is used instead; if that is
/// unset or empty, too, the best GPU is chosen, otherwise the best CPU, otherwise the first device. Of
/// several matching devices, GPUs with dedicated memory come first, then the one with the largest product of
/// arithmetic units and clock frequency, as far as devices report these. The same rule chooses between
/// several drivers for one card.
/// @throws Error if no device matches (the text lists the devices), and if there is none (it says what to
/// install, and what drivers need that are there, but offer no device).
[[nodiscard]] BROADCL_API Device select_device(std::string_view selector = {});

/// The same choice among given devices, without asking OpenCL or the environment.
/// @throws Error as above.
[[nodiscard]] BROADCL_API Device select_device(std::string_view selector, const std::vector<Device>& among);

}  // namespace broadcl

#endif
