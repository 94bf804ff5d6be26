#pragma once

#include "opencl/context.hpp"

namespace broadcl::opencl {

/// Whether a device takes denormal numbers for zeros, so that kernels must compare bounds as integers. It is
/// found out once per device and driver, by a kernel, and stored on disk.
/// @throws cl::Error; Error if zeros, infinities or NaNs of the device are not those of IEEE 754: pairs would
/// be wrong.
[[nodiscard]] bool flushes_denormals(const Context& context);

}  // namespace broadcl::opencl
