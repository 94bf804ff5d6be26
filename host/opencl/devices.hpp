#pragma once

#include <broadcl/device.hpp>

#include "opencl/api.hpp"

namespace broadcl::opencl {

/// The OpenCL device that a description stands for.
/// @throws Error when it is no longer there.
[[nodiscard]] cl::Device open(const Device& device);

}  // namespace broadcl::opencl
