#pragma once

#include <broadcl/device.hpp>

#include "opencl/api.hpp"

namespace broadcl::opencl {

/// The OpenCL device that a description stands for.
/// @throws Error if the device is no longer available.
[[nodiscard]] cl::Device open(const Device& device);

/// What a queue's device reports about itself. A sub-device has the id of its root device.
/// @throws Error if OpenCL fails.
[[nodiscard]] Device describe(const cl::CommandQueue& queue);

}  // namespace broadcl::opencl
