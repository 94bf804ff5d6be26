#pragma once

#include <cstddef>

#include <broadcl/device.hpp>

#include "opencl/api.hpp"

namespace broadcl::opencl {

/// What drivers do differently from what OpenCL says, or from each other, without reporting it. The rest of
/// the library asks here instead of looking at names of devices.
struct Quirks {
  /// Mesa's llvmpipe 22.3 silently ends a work-item after 65,535 iterations of its loops, counted over all of
  /// them, so it gets many small work-items, although it is a CPU.
  bool ends_long_loops = false;

  /// Mesa's rusticl 22.3 says of each kernel that it runs in work-groups of up to 32, and that it needs twice
  /// the local memory that it does, but runs them in as large work-groups as the device allows.
  bool misjudges_kernels = false;

  /// PoCL has its own cache of compiled programs. Exporting a binary takes it longer than everything else,
  /// because it compiles every kernel once more, for work-groups of any size.
  bool keeps_programs = false;

  /// PoCL has races if several threads build programs.
  bool builds_one_at_a_time = false;

  /// Intel's own driver for its GPUs allows buffers as large as the memory, with a flag, for kernels that are
  /// compiled with an option.
  bool has_large_buffers = false;
};

[[nodiscard]] Quirks quirks_of(const Device& device);

/// On any device, no work-item has more iterations of its loops, counted over all of them: then llvmpipe ends
/// it.
inline constexpr std::size_t most_iterations = 65'535;

/// Arithmetic units per compute unit. What drivers count as a compute unit differs by vendor.
[[nodiscard]] unsigned arithmetic_units(const Device& device);

/// How many work-items the device runs in lockstep, if an extension of AMD or NVIDIA tells; otherwise 0.
/// @throws cl::Error
[[nodiscard]] cl_uint reported_wave(const cl::Device& device);

/// Whether the device has NVIDIA's instruction with which the 32 work-items of a wave vote: kernels/vote.h.
/// @throws cl::Error
[[nodiscard]] bool has_nvidia_vote(const cl::Device& device);

}  // namespace broadcl::opencl
