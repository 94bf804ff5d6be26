#include "inverted_boxes.hpp"

#include <nanobind/stl/string.h>

#include <string>

#include <broadcl/box_view.hpp>

#include "gil.hpp"

namespace nb = nanobind;

namespace broadcl::python {
namespace {

/// The class, which is never destroyed.
PyObject*& category() {
  static PyObject* type = nullptr;
  return type;
}

/// What to do about them.
std::string remedy(const BoxArray& array, const InvertedBoxes& inverted) {
  if (array.layout() == ArrayLayout::min_max && inverted.likely == BoxLayout::axes) {
    return "are the columns xmin, xmax, ymin, ymax, ...? Then give layout='axes'";
  }
  if (array.layout() == ArrayLayout::min_max && inverted.likely == BoxLayout::centre_size) {
    return "are the columns a centre and a size? Then give layout='centre size' or 'centre half size'";
  }
  return "give broadcl.EMPTY for an object without a box";
}

}  // namespace

void add_inverted_boxes(nb::module_& module) {
  const auto scope = nb::cast<std::string>(module.attr("__name__"));
  category() = PyErr_NewExceptionWithDoc(
      (scope + ".InvertedBoxesWarning").c_str(),
      "Boxes with lower > upper on some axis were given, which overlap nothing; `EMPTY` does not count.\n\n"
      "The text has their number, the first row, and the likely layout.",
      PyExc_UserWarning, nullptr);
  if (category() == nullptr) throw nb::python_error();
  module.attr("InvertedBoxesWarning") = nb::handle(category());
  const auto [lower, upper] = empty_aabb();
  module.attr("EMPTY") = nb::make_tuple(lower[0], lower[1], lower[2], upper[0], upper[1], upper[2]);
}

void warn_of_inverted(std::initializer_list<const BoxArray*> arrays) {
  std::string found;
  std::string what_to_do;
  for (const BoxArray* array : arrays) {
    InvertedBoxes inverted;
    {
      const GilReleased released;
      inverted = array->view().inverted();
    }
    if (inverted.count == 0) continue;
    found += (found.empty() ? "" : ", and ") + std::to_string(inverted.count) + " of " +
             std::to_string(array->view().size()) + " rows of " + array->name() + ", the first of them row " +
             std::to_string(inverted.first);
    if (what_to_do.empty()) what_to_do = remedy(*array, inverted);
  }
  if (found.empty()) return;
  const std::string text =
      "inverted boxes (lower > upper), which overlap nothing: " + found + "; " + what_to_do;
  if (PyErr_WarnEx(category(), text.c_str(), 1) != 0) throw nb::python_error();
}

}  // namespace broadcl::python
