#include "opencl/devices.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/system.hpp"
#include "opencl/error.hpp"
#include "opencl/process.hpp"
#include "opencl/quirks.hpp"

namespace broadcl {
namespace {

using opencl::ask;

// Of the functions below, all_platforms(), platform_names(), all_devices() and describe() throw cl::Error.

std::vector<cl::Platform> all_platforms() {
  std::vector<cl::Platform> platforms;
  try {
    cl::Platform::get(&platforms);
  } catch (const cl::Error& error) {
    if (error.err() != opencl::no_platform) throw;
  }
  return platforms;
}

std::vector<std::string> platform_names() {
  std::vector<std::string> names;
  for (const cl::Platform& platform : all_platforms()) names.push_back(platform.getInfo<CL_PLATFORM_NAME>());
  return names;
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

std::string hexadecimal(unsigned value, unsigned digits) {
  std::string text;
  while (digits-- > 0) text += "0123456789abcdef"[value >> (4 * digits) & 15];
  return text;
}

std::string pci_address(unsigned domain, unsigned bus, unsigned device, unsigned function) {
  return hexadecimal(domain, 4) + ':' + hexadecimal(bus, 2) + ':' + hexadecimal(device, 2) + '.' +
         hexadecimal(function, 1);
}

// The following is from cl_ext.h, which declares it for some versions of the headers only.

std::string pci_address_of(const cl::Device& device, const std::string& extensions) {
  if (extensions.find("cl_khr_pci_bus_info") != std::string::npos) {
    constexpr cl_device_info bus_info = 0x410f;
    if (const auto info = ask<std::array<cl_uint, 4>>(device, bus_info)) {
      return pci_address((*info)[0], (*info)[1], (*info)[2], (*info)[3]);
    }
  }
  if (extensions.find("cl_nv_device_attribute_query") != std::string::npos) {
    constexpr cl_device_info bus_id = 0x4008;
    constexpr cl_device_info slot_id = 0x4009;
    constexpr cl_device_info domain_id = 0x400a;  // not in old drivers
    const auto bus = ask<cl_uint>(device, bus_id);
    const auto slot = ask<cl_uint>(device, slot_id);
    if (bus && slot)
      return pci_address(ask<cl_uint>(device, domain_id).value_or(0), *bus, *slot >> 3, *slot & 7);
  }
  if (extensions.find("cl_amd_device_attribute_query") != std::string::npos) {
    struct Topology {
      cl_uint type;
      std::array<cl_uchar, 17> unused;
      cl_uchar bus, device, function;
    };
    constexpr cl_device_info topology = 0x4037;
    constexpr cl_uint pcie = 1;
    const auto info = ask<Topology>(device, topology);
    if (info && info->type == pcie) return pci_address(0, info->bus, info->device, info->function);
  }
  return {};
}

std::string uuid_of(const cl::Device& device, const std::string& extensions) {
  if (extensions.find("cl_khr_device_uuid") == std::string::npos) return {};
  constexpr cl_device_info uuid = 0x106a;
  std::string text;
  if (const auto bytes = ask<std::array<cl_uchar, 16>>(device, uuid)) {
    for (const cl_uchar byte : *bytes) text += hexadecimal(byte, 2);
  }
  return text;
}

Device describe(const cl::Platform& platform, const cl::Device& device, std::size_t p, std::size_t d) {
  const auto extensions = device.getInfo<CL_DEVICE_EXTENSIONS>();
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
          .host_unified = device.getInfo<CL_DEVICE_HOST_UNIFIED_MEMORY>() == CL_TRUE,
          .vendor_id = device.getInfo<CL_DEVICE_VENDOR_ID>(),
          .pci_address = pci_address_of(device, extensions),
          .uuid = uuid_of(device, extensions)};
}

/// Why a device cannot be used, or nothing if it can.
std::string why_unusable(const cl::Device& device) {
  if (device.getInfo<CL_DEVICE_AVAILABLE>() == CL_FALSE) return "is not available";
  if (device.getInfo<CL_DEVICE_COMPILER_AVAILABLE>() == CL_FALSE) return "has no compiler for kernels";
  return {};
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

bool is_discrete(const Device& device) {
  return device.type == DeviceType::gpu && !device.host_unified;
}

/// The better of two devices has the greater rank.
std::pair<bool, std::uint64_t> rank(const Device& device) {
  return {is_discrete(device), std::uint64_t{device.compute_units} * opencl::arithmetic_units(device) *
                                   std::max(1U, device.clock_mhz)};
}

/// The best device that matches, the first of equals.
std::optional<Device> best_of(const std::vector<Device>& devices, const Matcher& matches) {
  std::optional<Device> best;
  for (const Device& device : devices) {
    if (matches(device) && (!best || rank(device) > rank(*best))) best = device;
  }
  return best;
}

Matcher of_type(DeviceType type) {
  return [type](const Device& device) { return device.type == type; };
}

/// @param platforms The names of those that are there.
Error no_device(const std::vector<std::string>& platforms) {
  const std::string install_pocl = "such as PoCL (Debian, Ubuntu: apt install pocl-opencl-icd)";
  if (platforms.empty()) {
    return Error("no OpenCL device found; install the driver of your GPU, or a CPU implementation " +
                 install_pocl);
  }
  const auto is_there = [&](std::string_view name) { return std::ranges::count(platforms, name) > 0; };
  std::string text = "no OpenCL device found, although drivers are installed:";
  for (const std::string& platform : platforms) text += (text.ends_with(':') ? " " : ", ") + platform;
  if (is_there("rusticl"))
    text += "; rusticl shows no device unless RUSTICL_ENABLE names its driver, radeonsi for instance";
  if (is_there("Portable Computing Language")) {
    text += "; PoCL shows none without a folder that it can write to: name one in POCL_CACHE_DIR";
  } else {
    text +=
        "; check that this user may open the GPU; without one, install a CPU implementation " + install_pocl;
  }
  return Error(text);
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

std::vector<Device> devices(std::vector<std::string>* failures) {
  opencl::use_in_this_process();  // before the lock, which another thread may have held at a fork
  // PoCL 3.1 returns devices that another thread's first call is still setting up.
  static std::mutex mutex;
  const std::scoped_lock lock(mutex);
  const auto platforms = opencl::translate_errors("OpenCL", all_platforms);
  std::vector<Device> result;
  std::vector<std::string> failed;
  /// A platform or device that fails must not hide others that work.
  const auto attempt = [&](const std::string& what, const auto& function) {
    try {
      opencl::translate_errors(what, function);
    } catch (const Error& error) {
      failed.emplace_back(error.what());
    }
  };
  for (std::size_t p = 0; p < platforms.size(); ++p) {
    std::vector<cl::Device> found;
    attempt("OpenCL platform " + std::to_string(p), [&] { found = all_devices(platforms[p]); });
    for (std::size_t d = 0; d < found.size(); ++d) {
      attempt("OpenCL device " + std::to_string(p) + ":" + std::to_string(d), [&] {
        const Device device = describe(platforms[p], found[d], p, d);
        if (const std::string why = why_unusable(found[d]); !why.empty()) {
          failed.push_back(device.label() + " (" + device.id() + ") " + why);
        } else {
          result.push_back(device);
        }
      });
    }
  }
  if (result.empty() && !failed.empty() && failures == nullptr) throw Error(failed.front());
  if (failures != nullptr) *failures = std::move(failed);
  return result;
}

Device select_device(std::string_view selector) {
  const std::vector<Device> found = devices();
  if (found.empty()) throw no_device(opencl::translate_errors("OpenCL", platform_names));
  const std::optional<std::string> variable = environment("BROADCL_DEVICE");
  return select_device(selector.empty() && variable ? *variable : selector, found);
}

Device select_device(std::string_view selector, const std::vector<Device>& among) {
  if (among.empty()) throw no_device({});
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

cl::Platform platform_of(const cl::Device& device) {
  cl_platform_id id = nullptr;
  device.getInfo(CL_DEVICE_PLATFORM, &id);
  return cl::Platform(id, true);
}

Device describe(const cl::CommandQueue& queue) {
  return translate_errors("the queue's device", [&] {
    const auto device = queue.getInfo<CL_QUEUE_DEVICE>();
    cl::Device root = device;
    for (cl::Device part = device; part() != nullptr; part = part.getInfo<CL_DEVICE_PARENT_DEVICE>())
      root = part;
    const cl::Platform platform = platform_of(device);
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
