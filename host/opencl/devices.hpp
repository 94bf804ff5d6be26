#pragma once

#include <optional>

#include <broadcl/device.hpp>

#include "opencl/api.hpp"

namespace broadcl::opencl {

/// The OpenCL device of a description.
/// @throws Error if the device is no longer available.
[[nodiscard]] cl::Device open(const Device& device);

/// What a queue's device reports about itself. A sub-device has the id of its root device.
/// @throws Error if OpenCL fails.
[[nodiscard]] Device describe(const cl::CommandQueue& queue);

/// The platform of a device, whose type in the bindings' getInfo<>() depends on their version.
/// @throws cl::Error
[[nodiscard]] cl::Platform platform_of(const cl::Device& device);

/// A property that a device reports through an extension; none if the query fails in spite of the extension.
/// @throws cl::Error
template <class Value>
[[nodiscard]] std::optional<Value> ask(const cl::Device& device, cl_device_info name) {
  Value value{};
  const cl_int error = clGetDeviceInfo(device(), name, sizeof(value), &value, nullptr);
  if (error == CL_INVALID_VALUE) return std::nullopt;
  if (error != CL_SUCCESS) throw cl::Error(error, "clGetDeviceInfo");
  return value;
}

}  // namespace broadcl::opencl
