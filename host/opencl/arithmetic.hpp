#pragma once

#include "opencl/context.hpp"

namespace broadcl::opencl {

/// Whether a device treats denormal numbers as zeros, so that kernels must compare bounds as integers. A
/// kernel tests this once per device and driver, and the result is stored on disk.
/// @throws cl::Error; Error if zeros, infinities or NaNs do not follow IEEE 754 on the device, because pairs
/// would be wrong.
[[nodiscard]] bool flushes_denormals(const Context& context);

}  // namespace broadcl::opencl
