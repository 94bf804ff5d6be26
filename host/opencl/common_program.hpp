#pragma once

#include "opencl/context.hpp"

namespace broadcl::opencl {

/// The program of the kernels that every object may need: kernels/common.cl.
/// @throws cl::Error, Error
[[nodiscard]] cl::Program common_program(const Context& context);

constexpr unsigned digit_bits = 8;  // of a pass of a sort, at most

}  // namespace broadcl::opencl
