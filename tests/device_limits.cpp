#include "device_limits.hpp"

#include <algorithm>
#include <optional>

namespace broadcl::test {
namespace {

std::optional<Limits> current;

/// Makes a number in an answer smaller, if there is an answer.
template <class Number>
void limit(std::size_t bytes, void* value, Number most) {
  if (value == nullptr || bytes < sizeof(Number)) return;
  auto* const number = static_cast<Number*>(value);
  *number = std::min(*number, most);
}

}  // namespace

LimitedDevices::LimitedDevices(const Limits& limits) : before_(current) {
  current = limits;
}

LimitedDevices::~LimitedDevices() {
  current = before_;
}

cl_int refusal_of_launch(cl_kernel kernel, cl_uint dimensions, const std::size_t* local) {
  if (!current) return CL_SUCCESS;
  std::size_t items = 1;
  for (cl_uint k = 0; local != nullptr && k < dimensions; ++k) items *= local[k];
  if (items > current->work_group) return CL_INVALID_WORK_GROUP_SIZE;
  const cl::Kernel retained(kernel, true);
  const cl::Device device = retained.getInfo<CL_KERNEL_CONTEXT>().getInfo<CL_CONTEXT_DEVICES>().front();
  const cl_ulong used = retained.getWorkGroupInfo<CL_KERNEL_LOCAL_MEM_SIZE>(device);
  return used > current->local_memory ? CL_OUT_OF_RESOURCES : CL_SUCCESS;
}

cl_int refusal_of_buffer(std::size_t bytes) {
  return current && bytes > current->allocation ? CL_INVALID_BUFFER_SIZE : CL_SUCCESS;
}

cl_int refusal_of_queue(cl_command_queue_properties properties) {
  const bool is_unknown = current && !current->has_profiling && (properties & CL_QUEUE_PROFILING_ENABLE) != 0;
  return is_unknown ? CL_INVALID_QUEUE_PROPERTIES : CL_SUCCESS;
}

std::string limited_options(const char* options) {
  std::string result = options != nullptr ? options : "";
  if (current && !current->has_denormals) result += " -cl-denorms-are-zero";
  return result;
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
  if (name == CL_DEVICE_QUEUE_PROPERTIES && !current->has_profiling && value != nullptr) {
    *static_cast<cl_command_queue_properties*>(value) &=
        ~static_cast<cl_command_queue_properties>(CL_QUEUE_PROFILING_ENABLE);
  }
  if (name == CL_DEVICE_COMPILER_AVAILABLE && !current->has_compiler) limit(bytes, value, cl_bool{CL_FALSE});
}

void limit_kernel_info(cl_kernel_work_group_info name, std::size_t bytes, void* value) {
  if (current && name == CL_KERNEL_WORK_GROUP_SIZE) limit(bytes, value, current->work_group);
}

}  // namespace broadcl::test
