#pragma once

/// The OpenCL C++ bindings, for the lowest layer of this library: OpenCL 1.2, failures thrown as cl::Error.
///
/// Never call cl::Platform::getDefault() or the bindings' other defaults: they store OpenCL objects in
/// globals.

#define CL_TARGET_OPENCL_VERSION 120
#define CL_HPP_TARGET_OPENCL_VERSION 120
#define CL_HPP_MINIMUM_OPENCL_VERSION 120
#define CL_HPP_ENABLE_EXCEPTIONS

#include <CL/opencl.hpp>

namespace broadcl::opencl {

/// CL_PLATFORM_NOT_FOUND_KHR: the loader finds no implementation, or there is no loader.
inline constexpr cl_int no_platform = -1001;

}  // namespace broadcl::opencl
