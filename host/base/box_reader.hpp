#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>

#include <broadcl/box_view.hpp>

namespace broadcl {

/// Reads the boxes of a view in blocks, as float32, without a copy if they lie in memory like that.
class BoxReader {
 public:
  static constexpr std::size_t block = 16;

  explicit BoxReader(const BoxView& view) : view_(view), boxes_(view.boxes()) {}

  /// At most a block of boxes from `first` on, which end before `end`; valid until the next call.
  [[nodiscard]] std::span<const Aabb> read(std::size_t first, std::size_t end) {
    const std::size_t count = std::min(block, end - first);
    if (boxes_ != nullptr) return {boxes_ + first, count};
    const std::span<Aabb> copy = std::span(copy_).first(count);
    view_.read(first, copy);
    return copy;
  }

  /// Calls function(k, box) for each box from `begin` to `end`.
  template <class Function>
  void for_each(std::size_t begin, std::size_t end, const Function& function) {
    for (std::size_t first = begin; first < end; first += block) {
      std::size_t k = first;
      for (const Aabb& box : read(first, end)) function(k++, box);
    }
  }

 private:
  const BoxView& view_;
  const Aabb* boxes_;
  std::array<Aabb, block> copy_;
};

}  // namespace broadcl
