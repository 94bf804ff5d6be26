#pragma once

#include <nanobind/nanobind.h>

#include <initializer_list>

#include "box_array.hpp"

namespace broadcl::python {

/// Adds the class InvertedBoxesWarning, and EMPTY, the box for which there is no warning.
void add_inverted_boxes(nanobind::module_& module);

/// Warns the caller once of all inverted boxes in these arrays. Releases the GIL.
/// @throws InvertedBoxesWarning if the caller made it an error.
void warn_of_inverted(std::initializer_list<const BoxArray*> arrays);

}  // namespace broadcl::python
