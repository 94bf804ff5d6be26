#pragma once

#include <cstddef>

namespace broadcl {

/// Memory of OpenCL that an object holds, in bytes. Program code and what a driver keeps for itself are not
/// counted.
struct MemoryUse {
  std::size_t device = 0;       ///< On the device, now.
  std::size_t device_peak = 0;  ///< The most that there was on the device at any time.
  std::size_t pinned = 0;  ///< Pinned memory of the host, through which data pass to the device and back.
};

}  // namespace broadcl
