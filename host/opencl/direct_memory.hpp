#pragma once

#include <cstddef>

#include "opencl/api.hpp"

namespace broadcl::opencl {

class Context;

/// Bytes that kernels read or write in direct memory at once, at most: more take less time in one transfer.
/// The changes that are ordered in one launch take fewer.
constexpr std::size_t most_direct = 256 << 10;

/// Allocates memory of the host that kernels access over the bus, also while it is mapped. Parameters as of
/// clCreateBuffer, after the second of which come flags of the extension.
using CreateDirect = cl_mem(CL_API_CALL*)(cl_context, cl_mem_flags, cl_bitfield, std::size_t, void*, cl_int*);

/// The function of NVIDIA's extension cl_nv_create_buffer that does so; null if the device does not have it.
/// @throws cl::Error
[[nodiscard]] CreateDirect find_direct_memory(const cl::Device& device);

/// @throws cl::Error
[[nodiscard]] cl::Buffer create_direct(CreateDirect create, const cl::Context& context, std::size_t bytes);

/// Whether kernels and host see at once what the other one writes to the direct memory of a context; false if
/// OpenCL fails. A kernel tests this once per device and driver, and the result is stored on disk.
/// @throws Error if the kernel does not compile.
[[nodiscard]] bool is_direct_memory_coherent(const Context& context);

}  // namespace broadcl::opencl
