#include "finders/byte_matrix.hpp"

#include <algorithm>
#include <array>
#include <cstring>

namespace broadcl {
namespace {

constexpr std::size_t block_bytes = 64;
using Block = std::array<std::uint64_t, block_bytes / sizeof(std::uint64_t)>;

Block load(const std::byte* bytes) {
  Block block;
  std::memcpy(&block, bytes, block_bytes);
  return block;
}

/// The offset of the first block at or after the given offset that must be looked at; at most the end of the
/// complete blocks that both frames have.
/// @param look_at_previous A mask: all ones to look at every pair of the last frame, 0 to look at changes
/// only.
std::size_t skip_unchanged_blocks(std::span<const std::byte> previous, std::span<const std::byte> current,
                                  std::size_t offset, std::uint64_t look_at_previous) {
  const std::size_t both = std::min(previous.size(), current.size());
  for (; offset + block_bytes <= both; offset += block_bytes) {
    const Block was = load(previous.data() + offset);
    const Block is = load(current.data() + offset);
    std::uint64_t interesting = 0;
    for (std::size_t k = 0; k < was.size(); ++k)
      interesting |= (was[k] ^ is[k]) | (was[k] & look_at_previous);
    if (interesting != 0) break;
  }
  return offset;
}

/// Walks through the triangle in the order of the index.
struct Cursor {
  std::uint32_t b = 1;
  std::size_t row_start = 0;

  Pair pair_at(std::size_t index) {
    while (index >= row_start + b) row_start += b++;
    return {static_cast<std::uint32_t>(index - row_start), b};
  }
};

}  // namespace

void find_changes(std::span<const std::byte> previous, std::span<const std::byte> current,
                  std::span<const std::uint32_t> recycled, std::vector<Pair>& added,
                  std::vector<Pair>& removed) {
  added.clear();
  removed.clear();
  const std::size_t size = std::max(previous.size(), current.size());
  const auto is_recycled = [&](const Pair& pair) {
    return std::binary_search(recycled.begin(), recycled.end(), pair.a) ||
           std::binary_search(recycled.begin(), recycled.end(), pair.b);
  };
  // If objects were recycled, pairs of the last frame must be looked at even if their byte stayed the same.
  const std::uint64_t look_at_previous = recycled.empty() ? 0 : ~std::uint64_t{0};
  Cursor cursor;
  for (std::size_t offset = 0; offset < size; offset += block_bytes) {
    offset = skip_unchanged_blocks(previous, current, offset, look_at_previous);
    const std::size_t end = std::min(size, offset + block_bytes);
    for (std::size_t index = offset; index < end; ++index) {
      const bool before = index < previous.size() && previous[index] != std::byte{0};
      const bool now = index < current.size() && current[index] != std::byte{0};
      if (!before && !now) continue;
      const Pair pair = cursor.pair_at(index);
      const bool other_pair = before && now && !recycled.empty() && is_recycled(pair);
      if (before && (!now || other_pair)) removed.push_back(pair);
      if (now && (!before || other_pair)) added.push_back(pair);
    }
  }
}

}  // namespace broadcl
