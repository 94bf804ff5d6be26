#include "opencl/devices.hpp"

#include <algorithm>
#include <cctype>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "opencl/error.hpp"
#include "system.hpp"

namespace broadcl {
namespace {

constexpr cl_int no_platform = -1001;  // CL_PLATFORM_NOT_FOUND_KHR: the loader found no implementation

// Of the functions below, all_platforms(), all_devices() and describe() throw cl::Error.

std::vector<cl::Platform> all_platforms() {
  std::vector<cl::Platform> platforms;
  try {
    cl::Platform::get(&platforms);
  } catch (const cl::Error& error) {
    if (error.err() != no_platform) throw;
  }
  return platforms;
}

std::vector<cl::Device> all_devices(const cl::Platform& platform) {
  std::vector<cl::Device> found;
  try {
    platform.getDevices(CL_DEVICE_TYPE_ALL, &found);
  } catch (const cl::Error& error) {
    if (error.err() != CL_DEVICE_NOT_FOUND) throw;
  }
  return found;
}

DeviceType to_type(cl_device_type type) {
  if ((type & CL_DEVICE_TYPE_GPU) != 0) return DeviceType::gpu;
  if ((type & CL_DEVICE_TYPE_CPU) != 0) return DeviceType::cpu;
  if ((type & CL_DEVICE_TYPE_ACCELERATOR) != 0) return DeviceType::accelerator;
  return DeviceType::other;
}

Device describe(const cl::Platform& platform, const cl::Device& device, std::size_t p, std::size_t d) {
  return {.platform = static_cast<unsigned>(p),
          .index = static_cast<unsigned>(d),
          .type = to_type(device.getInfo<CL_DEVICE_TYPE>()),
          .platform_name = platform.getInfo<CL_PLATFORM_NAME>(),
          .name = device.getInfo<CL_DEVICE_NAME>(),
          .version = device.getInfo<CL_DEVICE_VERSION>(),
          .driver_version = device.getInfo<CL_DRIVER_VERSION>(),
          .compute_units = device.getInfo<CL_DEVICE_MAX_COMPUTE_UNITS>(),
          .clock_mhz = device.getInfo<CL_DEVICE_MAX_CLOCK_FREQUENCY>(),
          .memory = device.getInfo<CL_DEVICE_GLOBAL_MEM_SIZE>(),
          .max_allocation = device.getInfo<CL_DEVICE_MAX_MEM_ALLOC_SIZE>(),
          .host_unified = device.getInfo<CL_DEVICE_HOST_UNIFIED_MEMORY>() == CL_TRUE};
}

std::string lower_case(std::string_view text) {
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return result;
}

std::string list_of(const std::vector<Device>& devices) {
  std::string list;
  for (const Device& device : devices) {
    list += (list.empty() ? "" : ", ") + device.id() + " (" + device.label() + ")";
  }
  return list;
}

using Matcher = std::function<bool(const Device&)>;

/// The best device that matches: most compute units times clock, the first of equals.
std::optional<Device> best_of(const std::vector<Device>& devices, const Matcher& matches) {
  std::optional<Device> best;
  const auto power = [](const Device& d) {
    return std::uint64_t{d.compute_units} * std::max(1U, d.clock_mhz);
  };
  for (const Device& device : devices) {
    if (matches(device) && (!best || power(device) > power(*best))) best = device;
  }
  return best;
}

Matcher of_type(DeviceType type) {
  return [type](const Device& device) { return device.type == type; };
}

Matcher matcher_of(std::string_view selector) {
  for (const DeviceType type : {DeviceType::gpu, DeviceType::cpu, DeviceType::accelerator}) {
    if (lower_case(selector) == to_string(type)) return of_type(type);
  }
  if (selector.find_first_not_of("0123456789:") == std::string_view::npos &&
      selector.find(':') != std::string_view::npos) {
    return [id = std::string(selector)](const Device& device) { return device.id() == id; };
  }
  return [part = lower_case(selector)](const Device& device) {
    return lower_case(device.label()).find(part) != std::string::npos;
  };
}

}  // namespace

std::string_view to_string(DeviceType type) noexcept {
  switch (type) {
    case DeviceType::gpu:
      return "gpu";
    case DeviceType::cpu:
      return "cpu";
    case DeviceType::accelerator:
      return "accelerator";
    case DeviceType::other:
      break;
  }
  return "other";
}

std::string Device::id() const {
  return std::to_string(platform) + ":" + std::to_string(index);
}

std::string Device::label() const {
  return platform_name + " / " + name;
}

std::vector<Device> devices() {
  // PoCL 3.1 returns devices that another thread's first call is still setting up.
  static std::mutex mutex;
  const std::scoped_lock lock(mutex);
  const auto platforms = opencl::translate_errors("OpenCL", all_platforms);
  std::vector<Device> result;
  for (std::size_t p = 0; p < platforms.size(); ++p) {
    opencl::translate_errors("OpenCL platform " + std::to_string(p), [&] {
      const std::vector<cl::Device> found = all_devices(platforms[p]);
      for (std::size_t d = 0; d < found.size(); ++d) result.push_back(describe(platforms[p], found[d], p, d));
    });
  }
  return result;
}

Device select_device(std::string_view selector) {
  const std::optional<std::string> variable = environment("BROADCL_DEVICE");
  if (selector.empty() && variable) return select_device(*variable, devices());
  return select_device(selector, devices());
}

Device select_device(std::string_view selector, const std::vector<Device>& among) {
  if (among.empty()) {
    throw Error(
        "no OpenCL device found; install the driver of your GPU, or a CPU implementation such as PoCL "
        "(Debian, Ubuntu: apt install pocl-opencl-icd)");
  }
  if (selector.empty()) {
    for (const DeviceType type : {DeviceType::gpu, DeviceType::cpu}) {
      if (const auto device = best_of(among, of_type(type))) return *device;
    }
    return among.front();
  }
  if (const auto device = best_of(among, matcher_of(selector))) return *device;
  throw Error("no OpenCL device matches '" + std::string(selector) + "'; use one of: " + list_of(among));
}

namespace opencl {

cl::Device open(const Device& device) {
  const auto find = [&]() -> std::optional<cl::Device> {
    const std::vector<cl::Platform> platforms = all_platforms();
    if (device.platform >= platforms.size()) return std::nullopt;
    const std::vector<cl::Device> found = all_devices(platforms[device.platform]);
    if (device.index >= found.size()) return std::nullopt;
    return found[device.index];
  };
  if (auto found = translate_errors(device.label(), find)) return *std::move(found);
  throw Error("device " + device.id() + " (" + device.label() + ") is no longer available; choose another");
}

Device describe(const cl::CommandQueue& queue) {
  return translate_errors("the queue's device", [&] {
    const auto device = queue.getInfo<CL_QUEUE_DEVICE>();
    cl::Device root = device;
    for (cl::Device part = device; part() != nullptr; part = part.getInfo<CL_DEVICE_PARENT_DEVICE>())
      root = part;
    const cl::Platform platform(device.getInfo<CL_DEVICE_PLATFORM>(), true);
    const std::vector<cl::Platform> platforms = all_platforms();
    const std::vector<cl::Device> siblings = all_devices(platform);
    const auto index_of = [](const auto& list, const auto& one) {
      return static_cast<std::size_t>(
          std::find_if(list.begin(), list.end(), [&](const auto& other) { return other() == one(); }) -
          list.begin());
    };
    return broadcl::describe(platform, device, index_of(platforms, platform), index_of(siblings, root));
  });
}

}  // namespace opencl
}  // namespace broadcl
