#pragma once

#include <cstddef>

#include "opencl/context.hpp"

namespace broadcl::opencl {

/// The program of the kernels that every object may need: kernels/common.cl.
/// @throws cl::Error, Error
[[nodiscard]] cl::Program common_program(const Context& context);

/// Work-items per work-group of those of its kernels that have local memory.
[[nodiscard]] inline std::size_t common_group(const Context& context) noexcept {
  return context.tuning() == Tuning::cpu ? 1 : 256;
}

/// Elements that a work-group sorts in local memory; with the tuning for CPUs it sorts none.
[[nodiscard]] inline std::size_t sort_tile(const Context& context) noexcept {
  return context.tuning() == Tuning::cpu ? 1 : 4096;
}
constexpr unsigned digit_bits = 8;  // of a pass of a sort, at most

}  // namespace broadcl::opencl
