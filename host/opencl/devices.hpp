#pragma once

#include <broadcl/device.hpp>

#include "opencl/api.hpp"

namespace broadcl::opencl {

/// The OpenCL device that a description stands for.
/// @throws Error when it is no longer there.
[[nodiscard]] cl::Device open(const Device& device);

/// What a queue's device reports of itself. A part of a device has the numbers of the whole.
/// @throws Error
[[nodiscard]] Device describe(const cl::CommandQueue& queue);

}  // namespace broadcl::opencl
