#include "opencl/quirks.hpp"

#include <array>
#include <string>
#include <string_view>
#include <utility>

#include "opencl/devices.hpp"

namespace broadcl::opencl {
namespace {

// From cl_ext.h, which declares them for other versions of OpenCL only.
constexpr cl_device_info compute_capability_major_of_nvidia = 0x4000;
constexpr cl_device_info warp_size_of_nvidia = 0x4003;
constexpr cl_device_info wavefront_width_of_amd = 0x4043;

bool has_extension(const cl::Device& device, std::string_view name) {
  return device.getInfo<CL_DEVICE_EXTENSIONS>().find(name) != std::string::npos;
}

}  // namespace

Quirks quirks_of(const Device& device) {
  const bool is_pocl = device.platform_name == "Portable Computing Language";
  return {
      .ends_long_loops = device.type == DeviceType::cpu && device.name.find("llvmpipe") != std::string::npos,
      .misjudges_kernels = device.platform_name == "rusticl" && device.driver_version.starts_with("22."),
      .keeps_programs = is_pocl,
      .builds_one_at_a_time = is_pocl,
      // (Its names are "Intel(R) OpenCL Graphics" and "Intel(R) OpenCL HD Graphics".)
      .has_large_buffers = device.type == DeviceType::gpu &&
                           device.platform_name.starts_with("Intel(R) OpenCL") &&
                           device.platform_name.ends_with("Graphics")};
}

unsigned arithmetic_units(const Device& device) {
  if (device.type != DeviceType::gpu) return 1;
  switch (device.vendor_id) {
    case 0x10de:  // NVIDIA: multiprocessors
      return 128;
    case 0x8086:  // Intel: execution units
      return 8;
    default:  // AMD: compute units
      return 64;
  }
}

cl_uint reported_wave(const cl::Device& device) {
  constexpr std::array<std::pair<std::string_view, cl_device_info>, 2> by_extension{
      {{"cl_amd_device_attribute_query", wavefront_width_of_amd},
       {"cl_nv_device_attribute_query", warp_size_of_nvidia}}};
  for (const auto& [extension, name] : by_extension) {
    if (!has_extension(device, extension)) continue;
    if (const auto width = ask<cl_uint>(device, name)) return *width;
  }
  return 0;
}

bool has_nvidia_vote(const cl::Device& device) {
  constexpr cl_uint volta = 7;
  return has_extension(device, "cl_nv_device_attribute_query") && reported_wave(device) == 32 &&
         ask<cl_uint>(device, compute_capability_major_of_nvidia) >= volta;
}

}  // namespace broadcl::opencl
