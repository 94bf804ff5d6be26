#pragma once

#include <cstdint>

/// What kernels and host must agree on: headers of kernels/ for the host.
namespace broadcl::layout {

using uint = std::uint32_t;
#include "../../kernels/counts.h"  // NOLINT(misc-include-cleaner)
#include "../../kernels/sizes.h"   // NOLINT(misc-include-cleaner)
#include "../../kernels/stamp.h"   // NOLINT(misc-include-cleaner)

static_assert(COUNTS % 2 == 0);

}  // namespace broadcl::layout
