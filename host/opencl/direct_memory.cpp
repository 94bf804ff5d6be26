#include "opencl/direct_memory.hpp"

#include <string>

#include "opencl/context.hpp"
#include "opencl/devices.hpp"
#include "opencl/launch.hpp"
#include "opencl/mapped_buffer.hpp"

namespace broadcl::opencl {
namespace {

// From NVIDIA's cl_ext.h.
constexpr cl_bitfield in_host_memory = 1;  // CL_MEM_LOCATION_HOST_NV
constexpr cl_bitfield pinned = 2;          // CL_MEM_PINNED_NV

/// Copies numbers from direct memory to direct memory: several, because a driver might copy memory only when
/// a kernel first uses it.
bool measure(const Context& context) {
  const MappedBuffer from = MappedBuffer::direct(context, sizeof(cl_uint));
  const MappedBuffer to = MappedBuffer::direct(context, sizeof(cl_uint));
  auto& written = *reinterpret_cast<cl_uint*>(from.host());
  auto& seen = *reinterpret_cast<cl_uint*>(to.host());
  cl::Kernel copy = context.kernel(context.program("arithmetic.cl"), "copy_number", 1);
  set_arguments(copy, 0, from.buffer(), to.buffer());
  for (cl_uint number = 1; number <= 3; ++number) {
    written = number;
    seen = 0;
    context.queue().enqueueNDRangeKernel(copy, cl::NullRange, cl::NDRange(1), cl::NDRange(1));
    context.queue().finish();
    if (seen != number) return false;
  }
  return true;
}

}  // namespace

CreateDirect find_direct_memory(const cl::Device& device) {
  if (device.getInfo<CL_DEVICE_EXTENSIONS>().find("cl_nv_create_buffer") == std::string::npos) return nullptr;
  return reinterpret_cast<CreateDirect>(
      clGetExtensionFunctionAddressForPlatform(platform_of(device)(), "clCreateBufferNV"));
}

cl::Buffer create_direct(CreateDirect create, const cl::Context& context, std::size_t bytes) {
  cl_int error = CL_SUCCESS;
  auto* const buffer = create(context(), CL_MEM_READ_WRITE, in_host_memory | pinned, bytes, nullptr, &error);
  if (error != CL_SUCCESS) throw cl::Error(error, "clCreateBufferNV");
  return cl::Buffer(buffer);
}

bool is_direct_memory_coherent(const Context& context) try {
  const std::string key = "direct memory";
  if (const auto stored = context.disk_cache().load(key); stored.size() == 1) return stored.front() != 0;
  const bool is_coherent = measure(context);
  (void)context.disk_cache().store(key, {static_cast<DiskCache::Bytes::value_type>(is_coherent ? 1 : 0)});
  return is_coherent;
} catch (const cl::Error&) {
  return false;
}

}  // namespace broadcl::opencl
