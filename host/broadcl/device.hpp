#pragma once

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
  std::uint32_t vendor_id;       ///< CL_DEVICE_VENDOR_ID: the number of the PCI bus, if there is one.
  std::string pci_address{};     ///< "0000:3b:00.0"; empty if the device does not say.
  std::string uuid{};            ///< CL_DEVICE_UUID_KHR, 32 hexadecimal digits; empty if there is none.

  /// "P:D", as the selector takes it.
  [[nodiscard]] std::string id() const;
  /// "platform / name".
  [[nodiscard]] std::string label() const;
};

/// Whether two devices are the same card, offered by two drivers. It is recognised by its PCI address,
/// otherwise by its UUID, otherwise by name and memory. CPUs, and devices of the same platform, never are.
[[nodiscard]] bool is_same_card(const Device& a, const Device& b);

/// Every usable device of every OpenCL platform, in the order of `clinfo -l`: those that are available and
/// have a compiler. Platforms without devices add none. Empty if no OpenCL implementation is installed.
/// @param failures Gets a line for each platform and device that cannot be used, and why, if it is not null.
/// @throws Error if there is no usable device, but one that failed, unless `failures` tells; and if the
/// loader fails.
[[nodiscard]] BROADCL_API std::vector<Device> devices(std::vector<std::string>* failures = nullptr);

/// Picks a device.
///
/// @param selector "P:D" with the numbers of `clinfo -l`; "gpu", "cpu" or "accelerator"; or a part of
///   "platform / name" in any case. If it is empty, the environment variable BROADCL_DEVICE is used instead;
///   if that is unset or empty too, the best GPU is chosen, otherwise the best CPU, otherwise the first
///   device. Of several GPUs, those with memory of their own come first; then the most arithmetic units times
///   clock frequency count, as far as devices tell. The same decides
///   between the drivers of one card.
/// @throws Error if no device matches (it lists the devices), and if there is none (it says what to install).
[[nodiscard]] BROADCL_API Device select_device(std::string_view selector = {});

/// The same choice among given devices, without asking OpenCL or the environment.
/// @throws Error as above.
[[nodiscard]] BROADCL_API Device select_device(std::string_view selector, const std::vector<Device>& among);

/// Why an empty selector takes which of these devices, for a person: "it is the only GPU", for instance. A
/// card that several drivers offer counts once.
/// @throws Error as above.
[[nodiscard]] BROADCL_API std::string reason_for_default(const std::vector<Device>& among);

}  // namespace broadcl
