#pragma once

#include <cstdint>

/// kernels/triangle.h for the host, so that host and kernels use the same index.
namespace broadcl::triangle {

using uint = std::uint32_t;
using ulong = std::uint64_t;
#include "../../kernels/triangle.h"  // NOLINT(misc-include-cleaner)

}  // namespace broadcl::triangle
