#include "box_array.hpp"

#include <nanobind/stl/string.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "arrays.hpp"
#include "device_arrays.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

using Array = nb::ndarray<nb::ro>;

bool is_float64(const Array& array) {
  return array.dtype() == nb::dtype<double>();
}

bool is_bounds(const Array& array) {
  return array.dtype() == nb::dtype<float>() || is_float64(array);
}

bool is_integers(const Array& array) {
  const auto code = static_cast<nb::dlpack::dtype_code>(array.dtype().code);
  return code == nb::dlpack::dtype_code::Int || code == nb::dlpack::dtype_code::UInt;
}

bool is_aligned(const Array& array) {
  return reinterpret_cast<std::uintptr_t>(array.data()) % array.itemsize() == 0;
}

std::size_t last(const Array& array) {
  return array.ndim() == 0 ? 0 : array.shape(array.ndim() - 1);
}

/// Whether this is [], which means no boxes.
bool is_empty_list(const Array& array) {
  return array.ndim() == 1 && array.shape(0) == 0;
}

bool is_sequence(nb::handle object) {
  return nb::isinstance<nb::list>(object) || nb::isinstance<nb::tuple>(object);
}

bool is_table(nb::handle object) {
  return !is_sequence(object) && nb::cast<int>(nb::getattr(object, "ndim", nb::int_(0))) == 2;
}

/// The same array for NumPy, which takes that of another package for one object.
nb::object to_numpy(nb::handle array) {
  if (nb::hasattr(array, "astype")) return nb::borrow(array);
  return nb::module_::import_("numpy").attr("from_dlpack")(array);
}

/// By ArrayLayout.
constexpr std::array layout_names = {"min max", "axes", "centre size", "centre half size", "points"};

ArrayLayout to_layout(const std::string& name) {
  std::string known;
  for (std::size_t k = 0; k < layout_names.size(); ++k) {
    if (name == layout_names.at(k)) return static_cast<ArrayLayout>(k);
    known += (known.empty() ? "'" : ", '") + std::string(layout_names.at(k)) + "'";
  }
  throw nb::value_error(("no layout is named '" + name + "'; the layouts are: " + known).c_str());
}

}  // namespace

void refuse_too_many(std::size_t boxes) {
  constexpr std::size_t most = std::size_t{1} << 31;
  if (boxes <= most) return;
  throw nb::value_error(
      (std::to_string(boxes) + " boxes are too many; use at most " + std::to_string(most)).c_str());
}

BoxArray::BoxArray(nb::handle boxes, std::string name, const std::string& layout)
    : name_(std::move(name)), layout_(to_layout(layout)) {
  const bool is_pair = nb::isinstance<nb::tuple>(boxes) && nb::len(boxes) == 2;
  if (is_pair) {
    take_two(boxes[0], boxes[1]);
  } else {
    take_one(boxes);
  }
  refuse_too_many(view_.size());
}

void BoxArray::refuse_nan() const {
  for (std::size_t k = 0; k < view_.size(); ++k) {
    if (!has_nan(view_[k])) continue;
    throw nb::value_error(("row " + std::to_string(k) + " of " + name_ +
                           " has a NaN bound; give an empty box (lower > upper) for an object without one")
                              .c_str());
  }
}

void BoxArray::refuse_type(nb::handle object) const {
  auto what = nb::cast<std::string>(object.type().attr("__name__"));
  if (const nb::object dtype = nb::getattr(object, "dtype", nb::none()); !dtype.is_none()) {
    what += std::string(" of ") + nb::str(nb::handle(dtype)).c_str();
  }
  throw nb::type_error(
      (name_ +
       " must be float32, float64 or integers in host memory: an array (NumPy, DLPack or buffer "
       "protocol) of shape (n, 6), (n, 2, 3) or (n, 4), or a tuple (lower, upper) of two of shape "
       "(n, 3); not " +
       what)
          .c_str());
}

void BoxArray::refuse_shape(const Array& array) const {
  std::string shape;
  for (std::size_t axis = 0; axis < array.ndim(); ++axis) {
    shape += std::to_string(array.shape(axis)) + (axis + 1 < array.ndim() ? ", " : "");
  }
  if (array.ndim() == 1) shape += ",";
  if (layout_ == ArrayLayout::points) {
    throw nb::value_error((name_ +
                           " must be of shape (n, 3) or (n, 2) in the layout 'points', or without n for one "
                           "point; not (" +
                           shape + ")")
                              .c_str());
  }
  throw nb::value_error(
      (name_ +
       " must be of shape (n, 6), (n, 2, 3) or (n, 4), or a tuple (lower, upper) of two arrays of "
       "shape (n, 3), or without n for one box; not (" +
       shape + ")" + (last(array) == 3 ? "; for points, give layout='points'" : ""))
          .c_str());
}

Array BoxArray::to_array(nb::handle object) const {
  if (is_on_device(object)) {
    throw nb::type_error((name_ + " must be in host memory here; copy it there, or use a DeviceBroadPhase, "
                                  "or overlapping_pairs() with all boxes on the device")
                             .c_str());
  }
  refuse_masked(object, name_);
  const nb::object numpy = nb::module_::import_("numpy");
  Array array;
  if (is_sequence(object)) {
    const nb::object numbers = numpy.attr("array")(object);
    const auto kind = nb::cast<std::string>(numbers.attr("dtype").attr("kind"));
    if (kind == "i" || kind == "u") return nb::cast<Array>(to_float64(numbers));
    return nb::cast<Array>(
        numpy.attr("asarray")(kind == "f" ? nb::handle(numbers) : object, "dtype"_a = "float64"));
  }
  // NumPy reads buffers in place, also those of ctypes, which have no strides.
  nb::object any = nb::hasattr(object, "__dlpack__") ? nb::borrow(object) : numpy.attr("asarray")(object);
  if (const nb::object dtype = nb::getattr(any, "dtype", nb::none()); nb::hasattr(dtype, "isnative")) {
    if (!nb::cast<bool>(dtype.attr("isnative"))) any = any.attr("astype")(dtype.attr("newbyteorder")("="));
  }
  const bool is_read = nb::try_cast(any, array, false);
  if (is_read && array.device_type() != nb::device::cpu::value) refuse_type(object);
  if (!is_read || !is_bounds(array) || !is_aligned(array)) {
    const nb::object copy = numpy.attr("array")(is_read ? to_numpy(any) : any, "order"_a = "C");
    if (!nb::try_cast(copy, array, false)) refuse_type(object);
    if (is_integers(array)) return nb::cast<Array>(to_float64(copy));
  }
  if (!is_bounds(array)) refuse_type(object);
  return array;
}

nb::object BoxArray::to_float64(const nb::object& integers) const {
  constexpr std::int64_t most = std::int64_t{1} << 53;
  for (const char* end : {"min", "max"}) {
    if (nb::cast<std::size_t>(integers.attr("size")) == 0) break;
    const nb::object integer = integers.attr(end)().attr("item")();
    std::int64_t value = 0;
    if (nb::try_cast(integer, value) && -most <= value && value <= most) continue;
    throw nb::value_error((name_ + " must be integers from -2^53 to 2^53, which float64 holds exactly, not " +
                           nb::str(integer).c_str() + "; convert the array to float64 to round them")
                              .c_str());
  }
  return integers.attr("astype")("float64");
}

/// The corners of boxes whose centres and sizes are given, in float64.
nb::tuple BoxArray::corners_of(nb::handle centres, nb::handle sizes) const {
  const nb::object numpy = nb::module_::import_("numpy");
  const double factor = layout_ == ArrayLayout::centre_size ? 0.5 : 1;
  const nb::object half = numpy.attr("multiply")(sizes, factor, "dtype"_a = "float64");
  return nb::make_tuple(numpy.attr("subtract")(centres, half), numpy.attr("add")(centres, half));
}

/// The same shape with lower and upper corners.
Array BoxArray::to_corners(Array array) const {
  const nb::object numpy = nb::module_::import_("numpy");
  const nb::object numbers = to_numpy(array.cast());
  if (layout_ == ArrayLayout::points) {
    return nb::cast<Array>(numpy.attr("concatenate")(nb::make_tuple(numbers, numbers), -1));
  }
  if (layout_ == ArrayLayout::axes) {
    const nb::object by_axis = numbers.attr("reshape")(-1, last(array) / 2, 2);
    return nb::cast<Array>(by_axis.attr("swapaxes")(1, 2).attr("reshape")(numbers.attr("shape")));
  }
  const int axis = last(array) == 3 ? -2 : -1;
  const nb::object halves = numpy.attr("split")(numbers, 2, axis);
  return nb::cast<Array>(numpy.attr("concatenate")(corners_of(halves[0], halves[1]), axis));
}

void BoxArray::take_one(nb::handle boxes) {
  if (is_sequence(boxes) && nb::len(boxes) == 2 && is_table(boxes[0]) && is_table(boxes[1])) {
    throw nb::value_error((name_ +
                           " is a list of two arrays; give the tuple (lower, upper), or numpy.stack() of the "
                           "corners of two boxes")
                              .c_str());
  }
  arrays_[0] = to_array(boxes);
  const Array& array = arrays_[0];
  const std::size_t dimensions = array.ndim();
  if (is_empty_list(array)) return;
  const bool are_points = layout_ == ArrayLayout::points;
  const bool is_corners =
      !are_points && dimensions >= 2 && last(array) == 3 && array.shape(dimensions - 2) == 2;
  const bool is_row =
      dimensions >= 1 && (last(array) == (are_points ? 3 : 6) || last(array) == (are_points ? 2 : 4));
  const std::size_t own = is_corners ? 2 : 1;  // dimensions of one box
  if ((!is_corners && !is_row) || dimensions > own + 1) refuse_shape(array);
  if (is_corners && layout_ == ArrayLayout::axes) {
    throw nb::value_error((name_ + " must be of shape (n, 6) or (n, 4) in the layout 'axes'").c_str());
  }
  is_single_ = dimensions == own;
  if (layout_ != ArrayLayout::min_max) arrays_[0] = to_corners(arrays_[0]);
  dimensions_ = last(array) == 4 ? 2 : 3;
  const bool is_repeated = !is_single_ && array.stride(0) == 0;
  if (is_repeated || (last(array) == 4 && array.stride(dimensions - 1) != 1)) {
    const nb::object numpy = nb::module_::import_("numpy");
    arrays_[0] = nb::cast<Array>(numpy.attr("ascontiguousarray")(to_numpy(arrays_[0].cast())));
  }
  if (is_float64(array)) {
    view_one<double>();
  } else {
    view_one<float>();
  }
}

template <class Bound>
void BoxArray::view_one() {
  const Array& array = arrays_[0];
  const std::size_t axis = array.ndim() - 1;
  const auto* numbers = static_cast<const Bound*>(array.data());
  const std::size_t n = is_single_ ? 1 : array.shape(0);
  constexpr auto bytes = static_cast<std::ptrdiff_t>(sizeof(Bound));
  const std::ptrdiff_t stride = is_single_ ? 6 * bytes : array.stride(0) * bytes;
  const std::ptrdiff_t step = array.stride(axis);
  if (last(array) == 4) {
    view_ = BoxView::rectangles(numbers, n, stride);
    return;
  }
  const Bound* upper = numbers + (last(array) == 3 ? array.stride(axis - 1) : 3 * step);
  view_ = BoxView::arrays<Bound>({numbers, numbers + step, numbers + 2 * step},
                                 {upper, upper + step, upper + 2 * step}, n, stride);
}

void BoxArray::take_two(nb::handle lower, nb::handle upper) {
  if (layout_ == ArrayLayout::axes || layout_ == ArrayLayout::points) {
    throw nb::value_error((name_ + " must be one array in the layout '" +
                           layout_names.at(static_cast<std::size_t>(layout_)) + "', not a tuple of two")
                              .c_str());
  }
  arrays_ = {to_array(lower), to_array(upper)};
  if (std::ranges::all_of(arrays_, is_empty_list)) return;
  dimensions_ = 3;
  for (const Array& array : arrays_) {
    if (array.ndim() < 1 || array.ndim() > 2 || last(array) != 3) refuse_shape(array);
  }
  const auto& [first, second] = arrays_;
  if (first.ndim() != second.ndim() || first.shape(0) != second.shape(0)) {
    throw nb::value_error(("lower and upper corners of " + name_ + " must be of the same shape").c_str());
  }
  is_single_ = first.ndim() == 1;
  if (layout_ != ArrayLayout::min_max) {
    const nb::tuple corners = corners_of(to_numpy(arrays_[0].cast()), to_numpy(arrays_[1].cast()));
    arrays_ = {nb::cast<Array>(corners[0]), nb::cast<Array>(corners[1])};
  }
  const bool is_alike = first.dtype() == second.dtype() &&
                        (is_single_ || (first.stride(0) == second.stride(0) && first.stride(0) != 0));
  if (!is_alike) {
    const nb::object numpy = nb::module_::import_("numpy");
    const char* type = is_float64(first) || is_float64(second) ? "float64" : "float32";
    for (Array& array : arrays_) {
      array = nb::cast<Array>(numpy.attr("ascontiguousarray")(to_numpy(array.cast()), "dtype"_a = type));
    }
  }
  if (is_float64(first)) {
    view_two<double>();
  } else {
    view_two<float>();
  }
}

template <class Bound>
void BoxArray::view_two() {
  const auto corner = [this](const Array& array) {
    const auto* numbers = static_cast<const Bound*>(array.data());
    const std::ptrdiff_t step = array.stride(is_single_ ? 0 : 1);
    return std::array{numbers, numbers + step, numbers + 2 * step};
  };
  const Array& lower = arrays_[0];
  constexpr auto bytes = static_cast<std::ptrdiff_t>(sizeof(Bound));
  view_ = BoxView::arrays<Bound>(corner(lower), corner(arrays_[1]), is_single_ ? 1 : lower.shape(0),
                                 is_single_ ? 3 * bytes : lower.stride(0) * bytes);
}

}  // namespace broadcl::python
