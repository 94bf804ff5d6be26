#pragma once

#include <string>
#include <string_view>
#include <utility>

#include <broadcl/error.hpp>

#include "opencl/api.hpp"
#include "opencl/process.hpp"

namespace broadcl::opencl {

/// "CL_OUT_OF_RESOURCES (-5)".
[[nodiscard]] std::string code_name(cl_int code);

/// An Error that names the device, the call, the code and the remedy.
[[nodiscard]] Error to_error(const cl::Error& error, std::string_view device);

/// Objects that are created from now on open their devices anew: opened_device.hpp.
void forget_opened_devices() noexcept;

/// Calls a function that uses OpenCL, and turns an OpenCL error that it throws into an Error. Since the
/// device may be lost, objects that are created afterwards open it anew.
/// @throws Error in a process that was forked after OpenCL was used.
template <class Function>
decltype(auto) translate_errors(std::string_view device, Function&& function) {
  use_in_this_process();
  try {
    return std::forward<Function>(function)();
  } catch (const cl::Error& error) {
    forget_opened_devices();
    throw to_error(error, device);
  }
}

}  // namespace broadcl::opencl
