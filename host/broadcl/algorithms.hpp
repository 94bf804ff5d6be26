#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <optional>
#include <span>
#include <string_view>

#include <broadcl/export.h>
#include <broadcl/config.hpp>
#include <broadcl/device.hpp>

namespace broadcl {

/// A row of the table of algorithms.
struct AlgorithmInfo {
  std::string_view name;     ///< The value for Config::algorithm.
  std::string_view summary;  ///< One line for people.
  bool on_device;            ///< False for an algorithm of the host; `auto` may use either.
};

/// The device that an object with this Config opens when it is made; none if it works on the host, always or
/// at first, as `auto` does unless a CPU is named. Any number of threads may call this at the same time.
/// @throws Error for an unknown algorithm or device, and if OpenCL fails.
[[nodiscard]] BROADCL_API std::optional<Device> device_for(const Config& config);

/// The table of all algorithms. The rows are constant and always valid; any number of threads may read them.
[[nodiscard]] BROADCL_API std::span<const AlgorithmInfo> algorithms() noexcept;

}  // namespace broadcl

#endif
