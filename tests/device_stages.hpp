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

}  // namespace broadcl::test
