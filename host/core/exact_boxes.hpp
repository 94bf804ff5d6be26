#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <broadcl/box_view.hpp>
#include <broadcl/pair.hpp>

#include "base/coordinate_map.hpp"
#include "base/packed_box.hpp"
#include "base/threads.hpp"

namespace broadcl {

/// The caller's boxes, one set or two, in double precision, for one search. They are searched in single
/// precision, and the pairs that are found are those of the caller's numbers.
class ExactBoxes {
 public:
  /// Whether the caller's numbers are more than float32 can tell. Otherwise float32 is exact.
  [[nodiscard]] static bool are_needed(const BoxView& first, const BoxView& second = {}) noexcept {
    return first.is_double_ || second.is_double_;
  }

  /// @param second Empty for one set. Its boxes follow those of the first.
  /// @param reach Of each box.
  /// @param threads At most; 0 for one per processor.
  /// @throws std::bad_alloc
  ExactBoxes(const BoxView& first, const BoxView& second, double reach, const Threads& threads);

  [[nodiscard]] std::size_t size() const noexcept { return first_.size() + second_.size(); }

  /// All boxes in single precision, packed.
  /// @param out As many as size().
  /// @returns The lowest index of a box with a NaN, or size() if there is none; `out` is then unspecified.
  [[nodiscard]] std::size_t pack_to(std::span<Aabb> out);

  /// The reaches of what pack_to() wrote; none if all are 0.
  /// @throws std::bad_alloc
  [[nodiscard]] std::vector<float> reaches(std::span<const Aabb> packed) const;

  /// Removes the pairs that only single precision takes for pairs.
  /// @param packed, reaches What pack_to() wrote, and reaches() returned.
  /// @param pairs Indices of the boxes.
  /// @throws std::bad_alloc
  void keep_pairs(std::vector<Pair>& pairs, std::span<const Aabb> packed,
                  std::span<const float> reaches) const;

 private:
  [[nodiscard]] Aabb64 box(std::size_t k) const noexcept {
    return k < first_.size() ? first_.exact(k) : second_.exact(k - first_.size());
  }
  /// Calls function(index of the first box, boxes) for blocks of the boxes from `begin` to `end`.
  template <class Function>
  void for_each_block(std::size_t begin, std::size_t end, const Function& function) const;

  BoxView first_;
  BoxView second_;
  double reach_;
  Threads threads_;
  CoordinateMap map_;
  AxisSet in_doubt_ = 0;
};

}  // namespace broadcl
