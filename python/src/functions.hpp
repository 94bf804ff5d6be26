#pragma once

#include <nanobind/nanobind.h>

namespace broadcl::python {

/// Makes the functions and classes of a module those of the package that it is in: that is their module, and
/// `inspect` finds the signatures of functions, of which nanobind's have none. Of overloads, it finds the
/// first.
///
/// (A module that is in no package keeps nanobind's functions, for the stub.)
void publish(nanobind::module_& module);

}  // namespace broadcl::python
