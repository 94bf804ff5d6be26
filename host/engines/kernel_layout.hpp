#pragma once

#include <cstddef>
#include <cstdint>

#include <broadcl/pair.hpp>

/// What kernels and host must agree on: headers of kernels/ for the host.
namespace broadcl::layout {

using uint = std::uint32_t;
#include "../../kernels/counts.h"  // NOLINT(misc-include-cleaner)
#include "../../kernels/pair.h"    // NOLINT(misc-include-cleaner)
#include "../../kernels/sizes.h"   // NOLINT(misc-include-cleaner)
#include "../../kernels/stamp.h"   // NOLINT(misc-include-cleaner)

static_assert(COUNTS % 2 == 0);
static_assert(offsetof(Pair, b) * 8 == PAIR_SECOND_BIT && sizeof(Pair) == 8);

}  // namespace broadcl::layout
