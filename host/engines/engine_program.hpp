#pragma once

#include <cstddef>

#include "opencl/context.hpp"

namespace broadcl {

/// Launch parameters of the kernels that surround any search.
struct EngineLaunch {
  std::size_t group;       ///< Work-items per work-group, of kernels that keep pairs or sort few changes.
  std::size_t keep_chunk;  ///< Pairs per work-item that keeps pairs.
};
[[nodiscard]] const EngineLaunch& engine_launch(const opencl::Context& context) noexcept;

/// The program of these kernels: kernels/engine.cl.
/// @throws cl::Error, Error
[[nodiscard]] cl::Program engine_program(const opencl::Context& context);

}  // namespace broadcl
