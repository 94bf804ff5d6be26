#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>

#include "opencl/api.hpp"

namespace broadcl::test {

/// What other devices allow less of than the real one, or answer differently.
struct Limits {
  std::size_t work_group = std::numeric_limits<std::size_t>::max();  ///< Work-items.
  /// The same for some kernels, by name.
  std::map<std::string, std::size_t> work_group_of_kernel{};
  cl_ulong local_memory = std::numeric_limits<cl_ulong>::max();                    ///< Bytes per work-group.
  cl_ulong allocation = std::numeric_limits<cl_ulong>::max();                      ///< Bytes per buffer.
  cl_command_queue_properties queue_properties = ~cl_command_queue_properties{0};  ///< That queues may have.
  bool has_devices = true;  ///< If not, platforms are there without any.
  bool has_compiler = true;
  bool has_denormals = true;             ///< If not, programs are built with -cl-denorms-are-zero.
  bool is_offered_twice = false;         ///< By platforms that follow the others.
  bool has_large_buffers = false;        ///< By Intel's flag, for kernels built with Intel's option.
  bool has_direct_memory = false;        ///< Of NVIDIA's extension, which `answers` must list.
  bool is_direct_memory_copied = false;  ///< And kernels and host see different memory then.
  std::map<cl_uint, std::string>
      answers{};  ///< The bytes of answers that replace those of platforms, devices and kernels.
};

/// The bytes of an answer.
template <class Value>
[[nodiscard]] std::string answer(const Value& value) {
  return {reinterpret_cast<const char*>(&value), sizeof(value)};
}

// Queries for the number of work-items that these vendors' GPUs run in lockstep: from cl_ext.h, which
// declares them only for other versions of OpenCL.
constexpr cl_uint wavefront_width_of_amd = 0x4043;
constexpr cl_uint warp_size_of_nvidia = 0x4003;

/// A device with memory of its own, and direct memory (Context::has_direct_memory()).
[[nodiscard]] Limits device_with_direct_memory();

/// A GPU that claims to be one of NVIDIA's, or of AMD's if it runs 64 work-items in lockstep.
[[nodiscard]] Limits gpu_with_waves_of(cl_uint width);

/// While it exists, all devices report these limits, and this program's OpenCL calls obey them, instead of
/// other limits that were set. It must not be created while objects exist that know those.
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

// Functions for the shim in failing_opencl.cpp: the error of a call that exceeds the limits, or CL_SUCCESS,
// and changes to answers.
[[nodiscard]] cl_int refusal_of_devices();
[[nodiscard]] cl_int refusal_of_launch(cl_kernel kernel, cl_uint dimensions, const std::size_t* local);
[[nodiscard]] cl_int refusal_of_buffer(cl_mem_flags flags, std::size_t bytes);
[[nodiscard]] cl_mem_flags known_flags(cl_mem_flags flags);
[[nodiscard]] cl_int refusal_of_argument(cl_kernel kernel, std::size_t bytes, const void* value);
[[nodiscard]] cl_int refusal_of_queue(cl_command_queue_properties properties);
/// @param options As the caller gave them, or null.
[[nodiscard]] std::string limited_options(cl_program program, const char* options);
/// @param buffer What clCreateBuffer returned, or null.
void note_buffer(cl_mem buffer, std::size_t bytes);
/// @param kernel What clCreateKernel returned, or null.
void note_kernel(cl_kernel kernel, cl_program program);
/// Whether an answer replaces that of a platform, device or kernel; if so, it has been written.
[[nodiscard]] bool is_answered(cl_uint name, std::size_t bytes, void* value, std::size_t* size);
/// @param really Whether the real device has it.
[[nodiscard]] bool has_direct_memory(bool really);
[[nodiscard]] bool is_direct_memory_copied();
/// From now on, the host sees other memory in place of a buffer's.
void set_apart(cl_mem buffer, std::size_t bytes);
/// That memory, or null.
[[nodiscard]] void* memory_apart(cl_mem buffer);
void list_twice(cl_uint entries, cl_platform_id* platforms, cl_uint* count);
void limit_device_info(cl_device_info name, std::size_t bytes, void* value);
void limit_kernel_info(cl_kernel kernel, cl_kernel_work_group_info name, std::size_t bytes, void* value);

}  // namespace broadcl::test
