#pragma once

#include <algorithm>
#include <cstddef>
#include <string>

#include <broadcl/error.hpp>

#include "opencl/api.hpp"
#include "opencl/context.hpp"

namespace broadcl::opencl {

/// How a list is split into blocks, which work-groups process from their first element to the last: block k
/// begins at element k * length, and the last block may be shorter.
struct Blocks {
  cl_uint count;
  cl_uint length;
};

/// Splits a list into just enough blocks to keep the device busy; more would only add to the work of
/// combining their results.
///
/// But no block is longer than `longest`, so that no work-item exceeds most_iterations.
/// @param n At least 1.
/// @param tile Lengths are multiples of it.
/// @param longest A multiple of tile.
/// @throws Error if n is 2^31 or more: indices of kernels would overflow.
[[nodiscard]] inline Blocks split_into_blocks(const Context& context, std::size_t n, std::size_t tile,
                                              std::size_t longest) {
  if (n >= std::size_t{1} << 31) {
    throw Error(context.device().label() + ": " + std::to_string(n) +
                " values are too many to sort or to add up at once; use fewer boxes");
  }
  const std::size_t enough =
      std::min<std::size_t>(4096, std::size_t{context.device().compute_units} * context.launch().blocks);
  const std::size_t tiles = (n + tile - 1) / tile;
  const std::size_t length = std::min((tiles + enough - 1) / enough * tile, longest);
  return {.count = static_cast<cl_uint>((n + length - 1) / length), .length = static_cast<cl_uint>(length)};
}

}  // namespace broadcl::opencl
