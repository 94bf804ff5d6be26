#include "opencl/opened_device.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <new>
#include <tuple>
#include <utility>
#include <vector>

#include "opencl/devices.hpp"
#include "opencl/error.hpp"
#include "opencl/process.hpp"

namespace broadcl::opencl {
namespace {

std::size_t largest_group_of(const cl::Device& device) {
  return std::min(device.getInfo<CL_DEVICE_MAX_WORK_GROUP_SIZE>(),
                  device.getInfo<CL_DEVICE_MAX_WORK_ITEM_SIZES>().front());
}

/// What objects must have in common to share a device. The context is null if it is the library's own.
using Key = std::tuple<cl_device_id, cl_context, std::optional<Tuning>, std::filesystem::path>;

struct Entry {
  Key key;
  std::weak_ptr<OpenedDevice> device;
  std::shared_ptr<OpenedDevice> kept;  // unless the context is the caller's
};

struct Registry {
  std::mutex mutex;
  std::vector<Entry> entries;
};

/// Never destroyed: some drivers crash if a static destructor releases what belongs to them. Needs no memory.
Registry& registry() noexcept {
  alignas(Registry) static std::array<std::byte, sizeof(Registry)> place;
  static auto* const the_registry = new (place.data()) Registry;
  return *the_registry;
}

/// @param make Makes a context for a device that is not shared yet.
template <class Make>
std::shared_ptr<OpenedDevice> find_or_open(const Device& device, const cl::Device& cl_device,
                                           cl_context callers_context, const Make& make) {
  const std::optional<Tuning> named = named_tuning();
  DiskCache disk_cache(device);
  const Key key{cl_device(), callers_context, named, disk_cache.folder()};
  Registry& known = registry();
  const std::scoped_lock lock(known.mutex);
  for (const Entry& entry : known.entries) {
    auto opened = entry.device.lock();
    if (opened == nullptr) continue;
    // (A queue may be of the library's own context.)
    const bool is_own = entry.kept != nullptr && opened->context() == callers_context;
    if (entry.key == (is_own ? Key{cl_device(), nullptr, named, std::get<3>(key)} : key)) return opened;
  }
  auto opened = std::make_shared<OpenedDevice>(device, cl_device, make(), named, std::move(disk_cache));
  std::erase_if(known.entries, [](const Entry& entry) { return entry.device.expired(); });
  known.entries.push_back({.key = key,
                           .device = opened,
                           .kept = callers_context == nullptr ? opened : std::shared_ptr<OpenedDevice>()});
  return opened;
}

}  // namespace

OpenedDevice::OpenedDevice(Device description, cl::Device opened, cl::Context in, std::optional<Tuning> named,
                           DiskCache stored)
    : device(std::move(description)),
      label(device.label()),
      cl_device(std::move(opened)),
      context(std::move(in)),
      quirks(quirks_of(device)),
      named_tuning(named),
      largest_group(largest_group_of(cl_device)),
      local_memory(cl_device.getInfo<CL_DEVICE_LOCAL_MEM_SIZE>()),
      disk_cache(std::move(stored)),
      programs(device, cl_device, context, disk_cache) {}

std::shared_ptr<OpenedDevice> opened_device(const Device& device) {
  use_in_this_process();
  const cl::Device cl_device = open(device);
  return find_or_open(device, cl_device, nullptr, [&] { return cl::Context(cl_device); });
}

std::shared_ptr<OpenedDevice> opened_device(const cl::CommandQueue& queue) {
  use_in_this_process();
  auto* const context = queue.getInfo<CL_QUEUE_CONTEXT>()();  // the queue owns it
  return find_or_open(describe(queue), queue.getInfo<CL_QUEUE_DEVICE>(), context,
                      [&] { return cl::Context(context, true); });
}

void forget_opened_devices() noexcept {
  std::vector<Entry> forgotten;  // is destroyed without the lock
  Registry& known = registry();
  const std::scoped_lock lock(known.mutex);
  forgotten.swap(known.entries);
}

}  // namespace broadcl::opencl
