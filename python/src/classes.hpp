#pragma once

#include <nanobind/nanobind.h>

namespace broadcl::python {

/// Adds the classes BroadPhase and Delta to the module.
void add_broad_phase(nanobind::module_& module);

}  // namespace broadcl::python
