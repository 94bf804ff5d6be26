#pragma once

#include <cstdint>

/// kernels/triangle.h for the host, so that the two cannot disagree.
namespace broadcl::triangle {

using uint = std::uint32_t;
using ulong = std::uint64_t;
#include "../../kernels/triangle.h"  // NOLINT(misc-include-cleaner)

}  // namespace broadcl::triangle
