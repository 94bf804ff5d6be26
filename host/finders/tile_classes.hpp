#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>

#include "base/packed_box.hpp"
#include "engines/algorithm.hpp"

namespace broadcl {

/// Divides objects into classes, such that those that share tiles have boxes of similar size and, if that
/// pays, of similar shape, and filters that refuse the same objects.
class TileClasses {
 public:
  /// Looks at a sample of the objects.
  /// @param input Must outlive this object.
  /// @throws std::bad_alloc
  explicit TileClasses(const Input& input);

  /// How many classes there are at most. Slots without a box are in none of them.
  static constexpr std::size_t count = 128;
  static constexpr std::uint8_t none = count;

  [[nodiscard]] std::uint8_t of(std::size_t slot) const noexcept {
    const Aabb& box = input_.boxes[slot];
    if (is_empty(box)) return none;
    std::size_t size = (std::max(size_exponent_of(slot), median_) - median_) / 2;
    std::size_t refused = 0;  // one bit per filter
    if (!input_.rules.filters.empty()) {
      const Filter& filter = input_.rules.filters[slot];
      if (filter.world == Filter::all_worlds) size = sizes - 1;
      for (const Filter& other : refusing_)
        refused = 2 * refused + static_cast<std::size_t>(refuse(filter, other));
    }
    const std::size_t shape = are_by_shape_ ? shape_of(box) : 0;
    return static_cast<std::uint8_t>((refused * shapes + shape) * sizes + std::min(size, sizes - 1));
  }

  /// Whether filters decide.
  [[nodiscard]] bool are_by_filter() const noexcept { return !refusing_.empty(); }

 private:
  /// Up to 4 times the median, up to 16 times, and so on, and at last everything larger, with the objects of
  /// all worlds.
  static constexpr std::size_t sizes = 4;
  static constexpr std::size_t shapes = 8;
  static constexpr std::size_t most_refusing = 2;
  static_assert(count == shapes * sizes << most_refusing);

  [[nodiscard]] static float largest_edge(const Aabb& box) noexcept {
    float edge = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) edge = std::max(edge, box.upper[axis] - box.lower[axis]);
    return edge;
  }
  /// Of the largest edge of the grown box, as floats store it.
  [[nodiscard]] std::uint32_t size_exponent_of(std::size_t slot) const noexcept {
    const float reach = input_.rules.reaches.empty() ? 0 : input_.rules.reaches[slot];
    return std::bit_cast<std::uint32_t>(largest_edge(input_.boxes[slot]) + 2 * reach) >> 23U;
  }
  /// One bit per axis: whether the box extends along it at least half as far as along any other.
  [[nodiscard]] static std::size_t shape_of(const Aabb& box) noexcept {
    std::size_t shape = 0;
    const float half = largest_edge(box) / 2;
    for (std::size_t axis = 0; axis < 3; ++axis)
      shape = 2 * shape + static_cast<std::size_t>(box.upper[axis] - box.lower[axis] >= half);
    return shape;
  }
  /// Whether the groups and masks keep two objects from pairing.
  [[nodiscard]] static bool refuse(const Filter& s, const Filter& t) noexcept {
    return (s.group & t.mask) == 0 || (t.group & s.mask) == 0;
  }

  [[nodiscard]] bool should_be_by_shape(std::span<const std::size_t> sample) const;
  void find_refusing(std::span<const std::size_t> sample);

  const Input& input_;
  std::uint32_t median_ = 0;  // of the exponents
  bool are_by_shape_ = false;
  std::vector<Filter> refusing_;  // that many objects have, and that refuse many
};

}  // namespace broadcl
