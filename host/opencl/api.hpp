#pragma once

/// The OpenCL C++ bindings, for the floor of this library: OpenCL 1.2, failures thrown as cl::Error.
///
/// Of the bindings, cl::Platform::getDefault() and its siblings keep OpenCL objects in globals: never call
/// them.

#define CL_TARGET_OPENCL_VERSION 120
#define CL_HPP_TARGET_OPENCL_VERSION 120
#define CL_HPP_MINIMUM_OPENCL_VERSION 120
#define CL_HPP_ENABLE_EXCEPTIONS

#include <CL/opencl.hpp>
