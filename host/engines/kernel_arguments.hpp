#pragma once

#include <cstddef>

#include "engines/kernel_layout.hpp"
#include "engines/search.hpp"
#include "opencl/launch.hpp"

/// kernels/arguments.h for the host, so that host and kernels use the same structs.
namespace broadcl::layout {

#include "../../kernels/arguments.h"  // NOLINT(misc-include-cleaner)

}  // namespace broadcl::layout

namespace broadcl {

/// Sets a kernel's PAIR_SINK_PARAMETERS of kernels/delta.h, from the given index on; returns the index after
/// the last of them.
/// @param capacity Of the list of pairs.
/// @param ungrown Of this frame, if distances are to be tested: Generation::ungrown.
/// @throws cl::Error
inline cl_uint set_pair_sink(cl::Kernel& kernel, cl_uint first, const Search& search, std::size_t capacity,
                             const cl::Buffer& pairs, const cl::Buffer& ungrown, const cl::Buffer& counts) {
  const cl::Buffer none;
  return opencl::set_arguments(kernel, first,
                               layout::sink_scalars_t{.capacity = static_cast<cl_uint>(capacity),
                                                      .last_slots = search.last.slots,
                                                      .stamp = search.changed.stamp},
                               pairs, ungrown, search.last.ungrown, search.last.boxes,
                               search.same_filters ? none : search.last.filters,
                               search.same_filters ? none : search.last.exclusions,
                               search.changed.recycled > 0 ? search.changed.stamps : none, counts);
}

}  // namespace broadcl
