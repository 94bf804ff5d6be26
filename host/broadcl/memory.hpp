#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <cstddef>

namespace broadcl {

/// OpenCL memory that an object holds, in bytes. Program code and the driver's own memory are not counted.
struct MemoryUse {
  std::size_t device = 0;       ///< On the device, now.
  std::size_t device_peak = 0;  ///< The largest value of `device` so far.
  std::size_t pinned = 0;       ///< Pinned memory of the host: for transfers, or accessed by kernels.
};

}  // namespace broadcl

#endif
