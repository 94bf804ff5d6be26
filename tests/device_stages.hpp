#pragma once

#include <broadcl/device.hpp>

#include "opencl/context.hpp"

namespace broadcl::test {

/// Whether few pairs are kept in a stage of their own, as with kernels tuned for CPUs.
inline bool has_keep_stage() {
  return opencl::Context(select_device(), false).tuning() == opencl::Tuning::cpu;
}

/// Whether few changes are uploaded and downloaded in stages of their own, as without direct memory.
inline bool has_transfer_stages() {
  return !opencl::Context(select_device(), false).has_direct_memory();
}

/// Whether commands take time. (Mesa's rusticl 22.3 reports the same time for all of them.)
inline bool device_clock_ticks() {
  const Device device = select_device();
  return device.platform_name != "rusticl" || !device.driver_version.starts_with("22.");
}

}  // namespace broadcl::test
