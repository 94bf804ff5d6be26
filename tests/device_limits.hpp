#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>

#include "opencl/api.hpp"

namespace broadcl::test {

/// What other devices allow less of than the one at hand.
struct Limits {
  std::size_t work_group = std::numeric_limits<std::size_t>::max();  ///< Work-items.
  cl_ulong local_memory = std::numeric_limits<cl_ulong>::max();      ///< Bytes per work-group.
  cl_ulong allocation = std::numeric_limits<cl_ulong>::max();        ///< Bytes per buffer.
  bool has_profiling = true;
  bool has_compiler = true;
  bool has_denormals = true;  ///< If not, programs are built with -cl-denorms-are-zero.
};

/// Makes all devices report, and this program's OpenCL calls keep to, these limits as long as it lives,
/// instead of others that are set. Not while objects live that know those.
class LimitedDevices {
 public:
  explicit LimitedDevices(const Limits& limits);
  ~LimitedDevices();
  LimitedDevices(const LimitedDevices&) = delete;
  LimitedDevices& operator=(const LimitedDevices&) = delete;
  LimitedDevices(LimitedDevices&&) = delete;
  LimitedDevices& operator=(LimitedDevices&&) = delete;

 private:
  std::optional<Limits> before_;
};

// What the shim of failing_opencl.cpp asks: the error of a call that exceeds the limits, or CL_SUCCESS, and
// what is to be changed in an answer.
[[nodiscard]] cl_int refusal_of_launch(cl_kernel kernel, cl_uint dimensions, const std::size_t* local);
[[nodiscard]] cl_int refusal_of_buffer(std::size_t bytes);
[[nodiscard]] cl_int refusal_of_queue(cl_command_queue_properties properties);
/// @param options As the caller gave them, or null.
[[nodiscard]] std::string limited_options(const char* options);
void limit_device_info(cl_device_info name, std::size_t bytes, void* value);
void limit_kernel_info(cl_kernel_work_group_info name, std::size_t bytes, void* value);

}  // namespace broadcl::test
