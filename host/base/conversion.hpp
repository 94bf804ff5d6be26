#pragma once

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>

#include "base/box_reader.hpp"
#include "base/coordinate_map.hpp"
#include "base/packed_box.hpp"

namespace broadcl {

/// A bit per box, by block.
using BlockBits = std::vector<std::uint16_t>;

[[nodiscard]] constexpr std::size_t blocks_of(std::size_t boxes) noexcept {
  return (boxes + boxes_per_block - 1) / boxes_per_block;
}

inline void insert_bit(BlockBits& blocks, std::size_t k) noexcept {
  blocks[k / boxes_per_block] |= static_cast<std::uint16_t>(1U << k % boxes_per_block);
}

/// Calls function(k) for each bit that is set.
template <class Function>
void for_each_bit(const BlockBits& blocks, const Function& function) {
  for (std::size_t block = 0; block < blocks.size(); ++block) {
    for (unsigned rest = blocks[block]; rest != 0; rest &= rest - 1)
      function(static_cast<std::uint32_t>(block * boxes_per_block) +
               static_cast<std::uint32_t>(std::countr_zero(rest)));
  }
}

/// Boxes are beyond what a map was made for: another one is needed. (No Error, which an algorithm might take
/// for one of its own.)
struct OutgrownMap : std::exception {};

/// All boxes become float32, by several threads.
class Conversion {
 public:
  /// @param map, out Must outlive this object.
  /// @param most_outside, most_away How many boxes may be outside and away.
  /// @throws std::bad_alloc
  Conversion(const CoordinateMap& map, std::span<Aabb> out, std::size_t boxes, std::size_t most_outside = any,
             std::size_t most_away = any)
      : map_(map), out_(out), away_(blocks_of(boxes)), most_outside_(most_outside), most_away_(most_away) {}

  /// @param first A multiple of boxes_per_block.
  void convert(std::size_t first, std::span<const Aabb64> block, std::span<Aabb> out) noexcept {
    const unsigned found = map_.convert(block, out);
    if ((found & ~found_.load(std::memory_order_relaxed)) != 0) found_ |= found;
    if ((found & CoordinateMap::away) == 0) return;
    unsigned away = 0;
    for (std::size_t k = 0; k < block.size(); ++k) {
      const unsigned found_of_one = map_.convert(block.subspan(k, 1), out.subspan(k, 1));
      away |= static_cast<unsigned>((found_of_one & CoordinateMap::away) != 0) << k;
      if ((found_of_one & CoordinateMap::outside) != 0) ++outside_count_;
    }
    away_[first / boxes_per_block] = static_cast<std::uint16_t>(away);
    away_count_ += static_cast<std::size_t>(std::popcount(away));
  }

  /// To be called once all are converted.
  /// @throws OutgrownMap if more boxes are outside or away than may be.
  void finish() const {
    if (outside_count_ > most_outside_ || away_count_ > most_away_) throw OutgrownMap();
  }

  /// Where the boxes are to be written.
  [[nodiscard]] std::span<Aabb> out() const noexcept { return out_; }
  /// The axes on which bounds may be told apart only in double precision.
  [[nodiscard]] AxisSet in_doubt() const noexcept { return found_ & CoordinateMap::in_doubt; }
  [[nodiscard]] BlockBits& away() noexcept { return away_; }
  [[nodiscard]] std::size_t away_count() const noexcept { return away_count_; }
  [[nodiscard]] std::size_t outside_count() const noexcept { return outside_count_; }

 private:
  static constexpr std::size_t any = ~std::size_t{0};

  const CoordinateMap& map_;
  std::span<Aabb> out_;
  BlockBits away_;
  std::size_t most_outside_, most_away_;
  std::atomic<unsigned> found_ = 0;
  std::atomic<std::size_t> away_count_ = 0, outside_count_ = 0;
};

}  // namespace broadcl
