#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include <broadcl/device.hpp>

#include "opencl/api.hpp"
#include "opencl/direct_memory.hpp"
#include "opencl/disk_cache.hpp"
#include "opencl/programs.hpp"
#include "opencl/quirks.hpp"
#include "opencl/tuning.hpp"

namespace broadcl::opencl {

/// A device with a context: what all objects that work there have in common. Several threads may use it.
struct OpenedDevice {
  /// @throws cl::Error
  OpenedDevice(Device description, cl::Device opened, cl::Context in, std::optional<Tuning> named,
               DiskCache stored);

  const Device device;
  const std::string label;  ///< Of the device, stored so that it needs no memory when a call has failed.
  const cl::Device cl_device;
  const cl::Context context;
  const Quirks quirks;
  const std::optional<Tuning> named_tuning;  ///< By the environment.
  const std::size_t largest_group;           ///< Work-items per work-group.
  const cl_ulong local_memory;               ///< Bytes per work-group.
  const DiskCache disk_cache;
  Programs programs;

  /// What has to be tested there.
  struct Findings {
    Tuning suitable_tuning = Tuning::cpu;
    std::string options = "-cl-std=CL1.2";  ///< For all programs.
    bool has_nvidia_vote = false;
    CreateDirect create_direct = nullptr;
  };
  std::mutex mutex;
  std::optional<Findings> findings;  ///< Of the first Context; guarded by the mutex.
};

/// The device of a description, with a context that all objects share. It is opened when it is first needed.
/// From then on it stays open, until an OpenCL call fails (forget_opened_devices()) or the process ends.
/// @throws cl::Error; Error if the device is no longer available.
[[nodiscard]] std::shared_ptr<OpenedDevice> opened_device(const Device& device);

/// The device and context of a queue of the caller, which objects share as long as one of them exists.
/// @throws cl::Error, Error
[[nodiscard]] std::shared_ptr<OpenedDevice> opened_device(const cl::CommandQueue& queue);

}  // namespace broadcl::opencl
