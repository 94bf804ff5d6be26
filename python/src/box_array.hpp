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

/// Boxes that a caller gives in any of the forms that docs/python.md lists, read where they are. Only what no
/// BoxView can view is copied: lists, columns of rectangles or of two arrays that are not the same distance
/// apart, one box that is repeated, memory that is misaligned or in the other byte order.
///
/// Made, copied and destroyed with the GIL; the view can be read without.
class BoxArray {
 public:
  /// @param name What messages call the boxes.
  /// @throws TypeError, ValueError
  BoxArray(nanobind::handle boxes, std::string name);

  [[nodiscard]] const BoxView& view() const noexcept { return view_; }
  /// Whether the caller gave one box, rather than an array of one.
  [[nodiscard]] bool is_single() const noexcept { return is_single_; }
  /// @throws ValueError that names the first row with a NaN bound.
  void refuse_nan() const;

 private:
  using Array = nanobind::ndarray<nanobind::ro>;

  [[nodiscard]] Array to_array(nanobind::handle object) const;
  [[noreturn]] void refuse_type(nanobind::handle object) const;
  [[noreturn]] void refuse_shape(const Array& array) const;
  template <class Bound>
  void view_one();
  template <class Bound>
  void view_two();
  void take_one(nanobind::handle boxes);
  void take_two(nanobind::handle lower, nanobind::handle upper);

  std::string name_;
  std::array<Array, 2> arrays_;  // all in one, or the lower and the upper corners
  BoxView view_;
  bool is_single_ = false;
};

}  // namespace broadcl::python
