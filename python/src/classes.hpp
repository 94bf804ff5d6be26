#pragma once

#include <nanobind/nanobind.h>

#include <string>

namespace broadcl::python {

/// Adds the classes BroadPhase and Delta to the module.
void add_broad_phase(nanobind::module_& module);

/// A Delta.
[[nodiscard]] nanobind::object make_delta(nanobind::object&& added, nanobind::object&& removed);

/// Adds the classes DeviceBroadPhase and DeviceDelta.
void add_device_broad_phase(nanobind::module_& module);

class Objects;
/// Adds the functions that query an object to the class BroadPhase.
void add_queries(nanobind::class_<Objects>& objects);

/// Adds the functions that search boxes once.
void add_searches(nanobind::module_& module);

/// Adds the functions that make filters and exclusions.
void add_pair_rules(nanobind::module_& module);

/// Adds the class DeviceArray.
void add_device_array(nanobind::module_& module);

/// All overlapping pairs of boxes on a device, in arrays of pyopencl or tensors, in such an array.
/// @param b None for one set.
/// @param exclusions As to_exclusions() takes them.
/// @param device Where to work; None for the queue or the device of `a`.
/// @throws TypeError, ValueError, Error
[[nodiscard]] nanobind::object find_on_device(nanobind::handle a, nanobind::handle b,
                                              nanobind::handle exclusions, nanobind::handle device,
                                              const std::string& algorithm);

/// Adds the class State.
void add_state(nanobind::module_& module);
/// Adds the functions that save and restore an object to the class BroadPhase.
void add_saving(nanobind::class_<Objects>& objects);

}  // namespace broadcl::python
