#pragma once

#include <nanobind/nanobind.h>

#include <string>

namespace broadcl::python {

/// Adds the classes BroadPhase and Delta to the module.
void add_broad_phase(nanobind::module_& module);

/// Adds the classes DeviceBroadPhase and DeviceDelta.
void add_device_broad_phase(nanobind::module_& module);

/// All overlapping pairs of boxes in arrays or buffers of pyopencl, in such an array.
/// @param b None for one set.
/// @param exclusions As to_exclusions() takes them.
/// @param queue Where to work; None for the queue of `a`.
/// @throws TypeError, ValueError, Error
[[nodiscard]] nanobind::object find_on_device(nanobind::handle a, nanobind::handle b,
                                              nanobind::handle exclusions, nanobind::handle queue,
                                              const std::string& algorithm);

}  // namespace broadcl::python
