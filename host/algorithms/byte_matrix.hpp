#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/pair.hpp>

namespace broadcl {

/// The changes between two frames of GPU-BF's results, one byte a pair in the order of the triangular index.
///
/// The two are XORed: where that is not zero the pair changed, and the byte of this frame says how. A pair of
/// which an object was recycled counts as another pair: it is removed if it was there, and added if it is
/// there.
///
/// @param previous Bytes of the last frame, row b for box b; may have fewer or more rows than `current`.
/// @param current Bytes of this frame.
/// @param recycled Slots whose object changed, ascending.
/// @param added, removed Overwritten, in canonical order.
void find_changes(std::span<const std::byte> previous, std::span<const std::byte> current,
                  std::span<const std::uint32_t> recycled, std::vector<Pair>& added,
                  std::vector<Pair>& removed);

}  // namespace broadcl
