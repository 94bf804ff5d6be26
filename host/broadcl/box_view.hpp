#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <array>
#include <concepts>
#include <cstddef>
#include <ranges>
#include <span>
#include <type_traits>

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>

namespace broadcl {

/// The type of the caller's bounds: float or double.
template <class S>
concept Bound = std::same_as<S, float> || std::same_as<S, double>;

/// What the numbers of a box may be.
enum class BoxLayout {
  min_max,      ///< Lower x, y, z, upper x, y, z.
  axes,         ///< Lower x, upper x, lower y, upper y, lower z, upper z.
  centre_size,  ///< Centre x, y, z, size x, y, z, or half of the size.
};

/// What BoxView::inverted() found.
struct InvertedBoxes {
  std::size_t count = 0;                  ///< Number of inverted boxes.
  std::size_t first = 0;                  ///< The lowest index of one; 0 if there is none.
  BoxLayout likely = BoxLayout::min_max;  ///< A layout in which none would be; min_max if none is likely.
};

/// A contiguous range of Aabb or Aabb64 that outlives the expression: a named std::vector or array, or a
/// range that does not own its boxes, such as std::span. A temporary std::vector does not qualify.
template <class Range>
concept AabbArray = std::ranges::contiguous_range<Range> && std::ranges::sized_range<Range> &&
    std::ranges::borrowed_range<Range> &&(std::same_as<std::ranges::range_value_t<Range>, Aabb> ||
                                          std::same_as<std::ranges::range_value_t<Range>, Aabb64>);

/// A read-only view of boxes in the caller's memory, in any layout with a constant distance between boxes.
/// Nothing is copied.
///
/// A view owns no memory. The memory that it shows must outlive it, and must not change while the view is
/// read. Any number of threads may read a view at the same time. Copying a view is cheap.
///
/// Bounds are float32 or float64. overlapping_pairs() and BroadPhase64 find the pairs of float64 boxes
/// exactly. Everything else reads them as float32: they are rounded outward as round_outward() does, except
/// that an empty box stays empty.
///
/// The functions that make a view take pointers to the bounds of box 0 and a stride, the distance in bytes
/// from each box to the next; 0 means without gaps. It must be a multiple of the bounds' alignment, and is
/// negative if each box precedes the last one in memory. Memory between the bounds is not read.
/// They throw Error for a null or misaligned pointer, for a misaligned stride, and for more boxes than memory
/// could hold; if n is 0, pointers are not checked.
class BROADCL_API BoxView {
 public:
  /// No boxes.
  BoxView() = default;

  /// The boxes of an array.
  template <AabbArray Range>
  BoxView(Range&& boxes)  // NOLINT(bugprone-forwarding-reference-overload): a BoxView is not an AabbArray
      : BoxView(interleaved(reinterpret_cast<const BoundOf<Range>*>(std::ranges::data(boxes)),
                            static_cast<std::size_t>(std::ranges::size(boxes)))) {}

  /// n boxes of six numbers each: lower x, y, z, upper x, y, z; the first box is at `numbers`.
  template <Bound S>
  [[nodiscard]] static BoxView interleaved(const S* numbers, std::size_t n, std::ptrdiff_t stride = 0) {
    if (n == 0) return {};
    if (stride == 0) stride = 6 * sizeof(S);
    check(std::array{numbers}, n, stride);
    return {corner_arrays(numbers), corner_arrays(numbers + 3), n, stride};
  }

  /// Two arrays of corners (x, y, z), both with the same stride.
  template <Bound S>
  [[nodiscard]] static BoxView corners(const S* lower, const S* upper, std::size_t n,
                                       std::ptrdiff_t stride = 0) {
    if (n == 0) return {};
    if (stride == 0) stride = 3 * sizeof(S);
    check(std::array{lower, upper}, n, stride);
    return {corner_arrays(lower), corner_arrays(upper), n, stride};
  }

  /// Six arrays, one per bound, all with the same stride: arrays<float>({x0, y0, z0}, {x1, y1, z1}, n).
  template <Bound S>
  [[nodiscard]] static BoxView arrays(const std::array<const S*, 3>& lower,
                                      const std::array<const S*, 3>& upper, std::size_t n,
                                      std::ptrdiff_t stride = 0) {
    if (n == 0) return {};
    if (stride == 0) stride = sizeof(S);
    check(lower, n, stride);
    check(upper, n, stride);
    return {lower, upper, n, stride};
  }

  /// n boxes in two dimensions, of four numbers each: lower x, y, upper x, y; the first box is at `numbers`.
  /// In z, they extend from 0 to 0.
  template <Bound S>
  [[nodiscard]] static BoxView rectangles(const S* numbers, std::size_t n, std::ptrdiff_t stride = 0) {
    if (n == 0) return {};
    if (stride == 0) stride = 4 * sizeof(S);
    check(std::array{numbers}, n, stride);
    return BoxView(std::array<const S*, 3>{numbers, numbers + 1, nullptr},
                   std::array<const S*, 3>{numbers + 2, numbers + 3, nullptr}, n, stride);
  }

  /// Number of boxes.
  [[nodiscard]] std::size_t size() const noexcept { return size_; }

  /// Box k, 0 <= k < size(), as float32.
  [[nodiscard]] Aabb operator[](std::size_t k) const noexcept;

  /// Counts the boxes whose lower bound exceeds the upper one on some axis, except that an axis from infinity
  /// to -infinity, as empty_aabb() has it, does not count. They overlap nothing, and are often a sign of
  /// numbers in another layout. Reads all boxes; a small part of the time of a search.
  [[nodiscard]] InvertedBoxes inverted() const noexcept;

  /// Copies all boxes as float32.
  /// @param out Must not overlap the viewed memory; boxes after the first size() are not changed.
  /// @throws Error if `out` is smaller than the view; then nothing is copied.
  void copy_to(std::span<Aabb> out) const;

 private:
  template <class Box>
  friend class BoxReader;
  friend class ExactBoxes;

  template <class Range>
  using BoundOf = std::conditional_t<std::same_as<std::ranges::range_value_t<Range>, Aabb64>, double, float>;

  template <Bound S>
  BoxView(const std::array<const S*, 3>& lower, const std::array<const S*, 3>& upper, std::size_t n,
          std::ptrdiff_t stride)
      : is_double_(std::same_as<S, double>), stride_(stride), size_(n) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      bounds_[axis] = reinterpret_cast<const std::byte*>(lower[axis]);
      bounds_[axis + 3] = reinterpret_cast<const std::byte*>(upper[axis]);
    }
  }

  template <class S>
  [[nodiscard]] static std::array<const S*, 3> corner_arrays(const S* corner) {
    return {corner, corner + 1, corner + 2};
  }

  template <class S, std::size_t count>
  static void check(const std::array<const S*, count>& pointers, std::size_t n, std::ptrdiff_t stride) {
    for (const S* pointer : pointers) check(pointer, alignof(S), n, stride);
  }
  static void check(const void* pointer, std::size_t alignment, std::size_t n, std::ptrdiff_t stride);

  /// Calls a function with the boxes as a type that knows their layout.
  template <class Function>
  auto with_layout(const Function& function) const;

  /// The boxes, if they are those of an array of Aabb, or of Aabb64; otherwise null.
  [[nodiscard]] const void* boxes(bool in_double) const noexcept;
  /// Copies as many boxes as there is memory for, from one on.
  template <class Box>
  void read(std::size_t first, std::span<Box> out) const noexcept;
  /// With the numbers that the caller has.
  [[nodiscard]] Aabb64 exact(std::size_t k) const noexcept;
  [[nodiscard]] bool are_rectangles() const noexcept { return size_ > 0 && bounds_[2] == nullptr; }

  bool is_double_ = false;
  std::ptrdiff_t stride_ = 0;
  std::size_t size_ = 0;
  std::array<const std::byte*, 6> bounds_{};  // of box 0: lower x, y, z, upper ones; no z in two dimensions
};

/// Any other range whose elements convert to Aabb.
template <class Range>
concept AabbRange = std::ranges::input_range<Range> && !std::convertible_to<Range, BoxView> &&
                    std::convertible_to<std::ranges::range_reference_t<Range>, Aabb>;

}  // namespace broadcl

#endif
