#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <type_traits>

#include <broadcl/box_view.hpp>

namespace broadcl {

inline constexpr std::size_t boxes_per_block = 16;

/// Reads the boxes of a view in blocks, as float32 or as float64, without a copy if they lie in memory like
/// that.
template <class Box>
class BoxReader {
 public:
  explicit BoxReader(const BoxView& view)
      : view_(view), boxes_(static_cast<const Box*>(view.boxes(std::is_same_v<Box, Aabb64>))) {}

  /// At most a block of boxes from `first` on, which end before `end`; valid until the next call.
  [[nodiscard]] std::span<const Box> read(std::size_t first, std::size_t end) {
    const std::size_t count = std::min(boxes_per_block, end - first);
    if (boxes_ != nullptr) return {boxes_ + first, count};
    const std::span<Box> copy = std::span(copy_).first(count);
    view_.read(first, copy);
    return copy;
  }

  /// Calls function(k, box) for each box from `begin` to `end`.
  template <class Function>
  void for_each(std::size_t begin, std::size_t end, const Function& function) {
    for (std::size_t first = begin; first < end; first += boxes_per_block) {
      std::size_t k = first;
      for (const Box& box : read(first, end)) function(k++, box);
    }
  }

 private:
  const BoxView& view_;
  const Box* boxes_;
  std::array<Box, boxes_per_block> copy_;
};

}  // namespace broadcl
