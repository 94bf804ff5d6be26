#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/pair.hpp>

namespace broadcl {

/// The changes between two frames of GPU-BF's results, one byte per pair in the order of the triangular
/// index.
///
/// The bytes of the two frames are XORed: if the result is not zero, the pair changed, and the byte of this
/// frame tells how. A pair with a recycled slot counts as a different pair: it is removed if it overlapped in
/// the last frame, and added if it overlaps in this one.
///
/// @param previous Bytes of the last frame, row b for box b; may have fewer or more rows than `current`.
/// @param current Bytes of this frame.
/// @param recycled Slots whose object changed, ascending.
/// @param added, removed Overwritten, in canonical order.
void find_changes(std::span<const std::byte> previous, std::span<const std::byte> current,
                  std::span<const std::uint32_t> recycled, std::vector<Pair>& added,
                  std::vector<Pair>& removed);

}  // namespace broadcl
