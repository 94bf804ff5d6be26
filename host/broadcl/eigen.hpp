#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

/// Eigen's boxes. Optional: the library itself does not need Eigen.

#include <array>
#include <concepts>
#include <cstddef>
#include <ranges>
#include <string>

#include <Eigen/Geometry>

#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/error.hpp>

namespace broadcl {

/// An empty Eigen box, as its default constructor makes it, stays empty.
[[nodiscard]] inline Aabb to_aabb(const Eigen::AlignedBox3f& box) noexcept {
  return {{box.min().x(), box.min().y(), box.min().z()}, {box.max().x(), box.max().y(), box.max().z()}};
}

/// Rounds outward: see round_outward().
[[nodiscard]] inline Aabb to_aabb(const Eigen::AlignedBox3d& box) noexcept {
  return round_outward({box.min().x(), box.min().y(), box.min().z()},
                       {box.max().x(), box.max().y(), box.max().z()});
}

[[nodiscard]] inline Eigen::AlignedBox3f to_eigen(const Aabb& box) noexcept {
  return {Eigen::Vector3f(box.lower.data()), Eigen::Vector3f(box.upper.data())};
}

/// A contiguous range of Eigen::AlignedBox3f or AlignedBox3d that outlives the expression: see AabbArray.
template <class Range>
concept AlignedBoxArray = std::ranges::contiguous_range<Range> && std::ranges::borrowed_range<Range> &&
    (std::same_as<std::ranges::range_value_t<Range>, Eigen::AlignedBox3f> ||
     std::same_as<std::ranges::range_value_t<Range>, Eigen::AlignedBox3d>);

/// A view of Eigen's boxes: see BoxView.
template <AlignedBoxArray Range>
[[nodiscard]] BoxView box_view(Range&& boxes) {
  const auto n = static_cast<std::size_t>(std::ranges::size(boxes));
  if (n == 0) return {};
  const auto& first = *std::ranges::data(boxes);
  return BoxView::corners(first.min().data(), first.max().data(), n, sizeof(first));
}

/// A view of the rows of an n x 6 matrix or array (lower x, y, z, upper x, y, z) of float or double in either
/// storage order: see BoxView. Maps, blocks and transposes of matrices can be viewed, too. Unevaluated
/// expressions and temporary matrices do not compile.
/// @throws Error unless there are six columns, and as BoxView does.
template <class Derived>
[[nodiscard]] BoxView box_view(const Eigen::DenseBase<Derived>& boxes) {
  using S = typename Derived::Scalar;
  constexpr bool has_bounds = Bound<S>;
  constexpr bool has_memory = (int{Derived::Flags} & int{Eigen::DirectAccessBit}) != 0;
  constexpr bool has_columns =
      int{Derived::ColsAtCompileTime} == 6 || int{Derived::ColsAtCompileTime} == Eigen::Dynamic;
  static_assert(has_bounds, "boxes are of float or double; use .cast<float>().eval()");
  static_assert(has_memory, "this expression is not stored in memory; store its .eval() in a variable");
  static_assert(has_columns, "boxes have six columns: lower x, y, z, upper x, y, z");
  if constexpr (has_bounds && has_memory && has_columns) {
    if (boxes.cols() != 6) {
      throw Error::invalid_argument("boxes have " + std::to_string(boxes.cols()) +
                                    " columns; give six: lower x, y, z, upper x, y, z");
    }
    if (boxes.rows() == 0) return {};
    const Derived& matrix = boxes.derived();
    std::array<const S*, 6> columns;
    for (Eigen::Index column = 0; column < 6; ++column) {
      columns[static_cast<std::size_t>(column)] = matrix.data() + column * matrix.colStride();
    }
    return BoxView::arrays<S>({columns[0], columns[1], columns[2]}, {columns[3], columns[4], columns[5]},
                              static_cast<std::size_t>(matrix.rows()),
                              matrix.rowStride() * static_cast<Eigen::Index>(sizeof(S)));
  }
}

template <class Derived>
BoxView box_view(const Eigen::PlainObjectBase<Derived>&& temporary) = delete;

/// A Ref to constant numbers may own a copy of them.
template <class Plain, int options, class Stride>
BoxView box_view(const Eigen::Ref<const Plain, options, Stride>&& temporary) = delete;

}  // namespace broadcl

#endif
