#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <array>
#include <cstddef>
#include <string>

#include <broadcl/box_view.hpp>

namespace broadcl::python {

/// @throws ValueError for more boxes than the core takes.
void refuse_too_many(std::size_t boxes);

/// What the numbers of a box are, as callers name it: "min max", "axes", "centre size", "centre half size",
/// "points".
enum class ArrayLayout { min_max, axes, centre_size, centre_half_size, points };

/// Boxes that a caller gives in any of the forms that docs/python.md lists, read where they are. Only what no
/// BoxView can view is copied: lists, integers, other layouts than "min max", columns of rectangles or of two
/// arrays that are not the same distance apart, one box that is repeated, memory that is misaligned or in the
/// other byte order.
///
/// Made, copied and destroyed with the GIL; the view can be read without.
class BoxArray {
 public:
  /// @param name What messages call the boxes.
  /// @param layout As callers name it.
  /// @throws TypeError, ValueError
  BoxArray(nanobind::handle boxes, std::string name, const std::string& layout);

  [[nodiscard]] const BoxView& view() const noexcept { return view_; }
  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  [[nodiscard]] ArrayLayout layout() const noexcept { return layout_; }
  /// 2 or 3; 0 for [], which are boxes of either.
  [[nodiscard]] std::size_t dimensions() const noexcept { return dimensions_; }
  /// Whether the caller gave one box, rather than an array of one.
  [[nodiscard]] bool is_single() const noexcept { return is_single_; }
  /// @throws ValueError that names the first row with a NaN bound.
  void refuse_nan() const;

 private:
  using Array = nanobind::ndarray<nanobind::ro>;

  [[nodiscard]] Array to_array(nanobind::handle object) const;
  [[noreturn]] void refuse_type(nanobind::handle object) const;
  [[noreturn]] void refuse_shape(const Array& array) const;
  [[nodiscard]] nanobind::object to_float64(const nanobind::object& integers) const;
  [[nodiscard]] nanobind::tuple corners_of(nanobind::handle centres, nanobind::handle sizes) const;
  [[nodiscard]] Array to_corners(Array array) const;
  template <class Bound>
  void view_one();
  template <class Bound>
  void view_two();
  void take_one(nanobind::handle boxes);
  void take_two(nanobind::handle lower, nanobind::handle upper);

  std::string name_;
  ArrayLayout layout_;
  std::array<Array, 2> arrays_;  // all in one, or the lower and the upper corners
  BoxView view_;
  bool is_single_ = false;
  std::size_t dimensions_ = 0;
};

}  // namespace broadcl::python
