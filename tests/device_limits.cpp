#include "device_limits.hpp"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "opencl/error.hpp"

namespace broadcl::test {
namespace {

std::optional<Limits> current;

constexpr cl_mem_flags large_buffer = 1 << 23;  // CL_MEM_ALLOW_UNRESTRICTED_SIZE_INTEL
std::set<cl_mem> large_buffers;
std::map<cl_mem, std::vector<std::byte>> buffers_apart;
std::set<cl_program> large_programs;
std::set<cl_kernel> large_kernels;

/// Limits a number in an answer, if there is an answer.
template <class Number>
void limit(std::size_t bytes, void* value, Number most) {
  if (value == nullptr || bytes < sizeof(Number)) return;
  auto* const number = static_cast<Number*>(value);
  *number = std::min(*number, most);
}

/// The largest number of work-items per work-group of a kernel.
std::size_t most_work_items(const cl::Kernel& kernel) {
  const auto& own_limits = current->work_group_of_kernel;
  const auto own = own_limits.find(kernel.getInfo<CL_KERNEL_FUNCTION_NAME>());
  return own == own_limits.end() ? current->work_group : std::min(current->work_group, own->second);
}

}  // namespace

Limits device_with_direct_memory() {
  return {.has_direct_memory = true,
          .answers = {{CL_DEVICE_HOST_UNIFIED_MEMORY, answer(cl_bool{CL_FALSE})},
                      {CL_DEVICE_EXTENSIONS, std::string("cl_nv_create_buffer") + '\0'}}};
}

Limits gpu_with_waves_of(cl_uint width) {
  const bool is_amd = width == 64;
  const std::string extension = is_amd ? "cl_amd_device_attribute_query" : "cl_nv_device_attribute_query";
  return {.answers = {{CL_DEVICE_TYPE, answer(cl_device_type{CL_DEVICE_TYPE_GPU})},
                      {CL_DEVICE_EXTENSIONS, extension + '\0'},
                      {is_amd ? wavefront_width_of_amd : warp_size_of_nvidia, answer(width)}}};
}

LimitedDevices::LimitedDevices(const Limits& limits) : before_(current) {
  current = limits;
  opencl::forget_opened_devices();
}

LimitedDevices::~LimitedDevices() {
  current = before_;
  opencl::forget_opened_devices();
}

cl_int refusal_of_devices() {
  return current && !current->has_devices ? CL_DEVICE_NOT_FOUND : CL_SUCCESS;
}

cl_int refusal_of_launch(cl_kernel kernel, cl_uint dimensions, const std::size_t* local) {
  if (!current) return CL_SUCCESS;
  std::size_t items = 1;
  for (cl_uint k = 0; local != nullptr && k < dimensions; ++k) items *= local[k];
  const cl::Kernel retained(kernel, true);
  if (items > most_work_items(retained)) return CL_INVALID_WORK_GROUP_SIZE;
  const cl::Device device = retained.getInfo<CL_KERNEL_CONTEXT>().getInfo<CL_CONTEXT_DEVICES>().front();
  const cl_ulong used = retained.getWorkGroupInfo<CL_KERNEL_LOCAL_MEM_SIZE>(device);
  return used > current->local_memory ? CL_OUT_OF_RESOURCES : CL_SUCCESS;
}

cl_int refusal_of_buffer(cl_mem_flags flags, std::size_t bytes) {
  if (!current || bytes <= current->allocation) return CL_SUCCESS;
  return current->has_large_buffers && (flags & large_buffer) != 0 ? CL_SUCCESS : CL_INVALID_BUFFER_SIZE;
}

cl_mem_flags known_flags(cl_mem_flags flags) {
  return current && current->has_large_buffers ? flags & ~large_buffer : flags;
}

bool has_direct_memory(bool really) {
  return current ? current->has_direct_memory : really;
}

bool is_direct_memory_copied() {
  return current && current->is_direct_memory_copied;
}

void set_apart(cl_mem buffer, std::size_t bytes) {
  if (buffer != nullptr) buffers_apart[buffer].resize(bytes);
}

void* memory_apart(cl_mem buffer) {
  const auto found = buffers_apart.find(buffer);
  return found == buffers_apart.end() ? nullptr : found->second.data();
}

void note_buffer(cl_mem buffer, std::size_t bytes) {
  buffers_apart.erase(buffer);
  if (!current || bytes <= current->allocation) {
    large_buffers.erase(buffer);
  } else {
    large_buffers.insert(buffer);
  }
}

void note_kernel(cl_kernel kernel, cl_program program) {
  if (large_programs.contains(program)) {
    large_kernels.insert(kernel);
  } else {
    large_kernels.erase(kernel);
  }
}

cl_int refusal_of_argument(cl_kernel kernel, std::size_t bytes, const void* value) {
  if (large_buffers.empty() || bytes != sizeof(cl_mem) || value == nullptr) return CL_SUCCESS;
  cl_mem buffer = nullptr;
  std::memcpy(static_cast<void*>(&buffer), value, bytes);
  return large_buffers.contains(buffer) && !large_kernels.contains(kernel) ? CL_INVALID_ARG_VALUE
                                                                           : CL_SUCCESS;
}

cl_int refusal_of_queue(cl_command_queue_properties properties) {
  const bool is_unknown = current && (properties & ~current->queue_properties) != 0;
  return is_unknown ? CL_INVALID_QUEUE_PROPERTIES : CL_SUCCESS;
}

std::string limited_options(cl_program program, const char* options) {
  constexpr std::string_view for_large_buffers = "-cl-intel-greater-than-4GB-buffer-required";
  std::string result = options != nullptr ? options : "";
  large_programs.erase(program);
  if (const std::size_t place = result.find(for_large_buffers);
      place != std::string::npos && current && current->has_large_buffers) {
    result.erase(place, for_large_buffers.size());
    large_programs.insert(program);
  }
  if (current && !current->has_denormals) result += " -cl-denorms-are-zero";
  return result;
}

bool is_answered(cl_uint name, std::size_t bytes, void* value, std::size_t* size) {
  if (!current || !current->answers.contains(name)) return false;
  const std::string& text = current->answers.at(name);
  if (size != nullptr) *size = text.size();
  if (value != nullptr) std::memcpy(value, text.data(), std::min(bytes, text.size()));
  return true;
}

void list_twice(cl_uint entries, cl_platform_id* platforms, cl_uint* count) {
  if (!current || !current->is_offered_twice) return;
  if (count != nullptr) *count *= 2;
  if (platforms != nullptr) std::copy_n(platforms, entries / 2, platforms + entries / 2);
}

void limit_device_info(cl_device_info name, std::size_t bytes, void* value) {
  if (!current) return;
  if (name == CL_DEVICE_MAX_WORK_GROUP_SIZE) limit(bytes, value, current->work_group);
  if (name == CL_DEVICE_MAX_WORK_ITEM_SIZES && value != nullptr) {
    for (std::size_t k = 0; k < bytes / sizeof(std::size_t); ++k) {
      limit(sizeof(std::size_t), static_cast<std::size_t*>(value) + k, current->work_group);
    }
  }
  if (name == CL_DEVICE_LOCAL_MEM_SIZE) limit(bytes, value, current->local_memory);
  if (name == CL_DEVICE_MAX_MEM_ALLOC_SIZE) limit(bytes, value, current->allocation);
  if (name == CL_DEVICE_QUEUE_PROPERTIES && value != nullptr) {
    *static_cast<cl_command_queue_properties*>(value) &= current->queue_properties;
  }
  if (name == CL_DEVICE_COMPILER_AVAILABLE && !current->has_compiler) limit(bytes, value, cl_bool{CL_FALSE});
}

void limit_kernel_info(cl_kernel kernel, cl_kernel_work_group_info name, std::size_t bytes, void* value) {
  if (!current || name != CL_KERNEL_WORK_GROUP_SIZE || value == nullptr) return;
  limit(bytes, value, most_work_items(cl::Kernel(kernel, true)));
}

}  // namespace broadcl::test
