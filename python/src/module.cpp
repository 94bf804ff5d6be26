#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cstddef>
#include <exception>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include <broadcl/version.h>
#include <broadcl/broad_phase.hpp>
#include <broadcl/filter.hpp>

#include "classes.hpp"
#include "config.hpp"
#include "functions.hpp"
#include "gil.hpp"
#include "inverted_boxes.hpp"
#include "keywords.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {

std::string to_text(const Selector& selector) {
  if (!selector) return {};
  if (const auto* device = std::get_if<Device>(&*selector)) return device->id();
  return std::get<std::string>(*selector);
}

Config to_config(const Selector& device, const std::string& algorithm, std::size_t threads, bool profile,
                 double distance) {
  std::string known;
  for (const AlgorithmInfo& row : algorithms()) {
    if (row.name == algorithm) {
      return {.device = to_text(device),
              .algorithm = algorithm,
              .threads = threads,
              .distance = distance,
              .profile = profile};
    }
    known += (known.empty() ? "" : ", ") + std::string(row.name);
  }
  throw nb::value_error(("no algorithm is named '" + algorithm + "'; the algorithms are: " + known).c_str());
}

namespace {

nb::dict algorithm_summaries() {
  nb::dict result;
  for (const AlgorithmInfo& row : algorithms()) {
    result[nb::str(row.name.data(), row.name.size())] = nb::str(row.summary.data(), row.summary.size());
  }
  return result;
}

/// Those that need no device; `auto` then stays on the host.
std::vector<std::string> host_algorithms() {
  std::vector<std::string> result;
  for (const AlgorithmInfo& row : algorithms()) {
    if (!row.on_device || row.name == "auto") result.emplace_back(row.name);
  }
  return result;
}

nb::object add_exception(nb::module_& module, const std::string& name, nb::handle base,
                         const char* description) {
  const auto scope = nb::cast<std::string>(module.attr("__name__"));
  auto type =
      nb::steal(PyErr_NewExceptionWithDoc((scope + "." + name).c_str(), description, base.ptr(), nullptr));
  if (!type.is_valid()) throw nb::python_error();
  module.attr(name.c_str()) = type;
  return type;
}

void add_errors(nb::module_& module) {
  const nb::object error =
      add_exception(module, "Error", PyExc_RuntimeError,
                    "What was requested cannot be done, for instance because a device or driver fails.\n\n"
                    "The text says what to do.");
  const nb::object memory =
      add_exception(module, "OutOfDeviceMemory", error,
                    "OpenCL has too little memory. The object can be used with fewer boxes or pairs.");
  const nb::object lost = add_exception(module, "DeviceLost", error,
                                        "The device may be lost: create a new object.\n\n"
                                        "(Some drivers report exhausted memory in the same way.)");
  // By ErrorKind. The module owns the classes, and is never unloaded.
  static std::array<PyObject*, 4> classes;
  classes = {error.ptr(), PyExc_ValueError, memory.ptr(), lost.ptr()};
  nb::register_exception_translator(
      [](const std::exception_ptr& thrown, void* by_kind) {
        try {
          std::rethrow_exception(thrown);
        } catch (const Error& failure) {
          const auto& types = *static_cast<const std::array<PyObject*, 4>*>(by_kind);
          PyErr_SetString(types.at(static_cast<std::size_t>(failure.kind())), failure.what());
        }
      },
      &classes);
}

std::vector<Device> all_devices() {
  const GilReleased released;
  return devices();
}

Device choose_device(const Selector& selector) {
  const GilReleased released;
  return select_device(to_text(selector));
}

bool is_same_device(const Device& s, const Device& t) {
  return s.id() == t.id() && s.label() == t.label() && s.driver_version == t.driver_version;
}

auto state_of(const Device& device) {
  return std::tuple(device.platform, device.index, static_cast<int>(device.type), device.platform_name,
                    device.name, device.version, device.driver_version, device.compute_units,
                    device.clock_mhz, device.memory, device.max_allocation, device.host_unified,
                    device.vendor_id, device.pci_address, device.uuid);
}

void set_state(Device& device, const decltype(state_of(device))& state) {
  std::apply(
      [&](unsigned platform, unsigned index, int type, const auto&... rest) {
        new (&device) Device{platform, index, static_cast<DeviceType>(type), rest...};
      },
      state);
}

void add_device(nb::module_& module) {
  nb::class_<Device>(
      module, "Device",
      "What an OpenCL device reports about itself. A plain value that holds no OpenCL object, and can be "
      "pickled.\n\n"
      "devices() and select_device() return them; there is no constructor.")
      .def_prop_ro("id", &Device::id, "``\"P:D\"``: the numbers of platform and device in ``clinfo -l``.")
      .def_prop_ro(
          "type", [](const Device& device) { return std::string(to_string(device.type)); },
          "``\"gpu\"``, ``\"cpu\"``, ``\"accelerator\"`` or ``\"other\"``.")
      .def_ro("platform_name", &Device::platform_name, "The name of its platform.")
      .def_ro("name", &Device::name, "Its name.")
      .def_ro("version", &Device::version, "OpenCL version, for instance ``\"OpenCL 3.0 CUDA\"``.")
      .def_ro("driver_version", &Device::driver_version, "The version of its driver.")
      .def_ro("compute_units", &Device::compute_units, "Number of compute units.")
      .def_ro("clock_mhz", &Device::clock_mhz, "Highest clock frequency, MHz; 0 if the device does not say.")
      .def_ro("memory", &Device::memory, "Global memory, bytes.")
      .def_ro("max_allocation", &Device::max_allocation, "Largest buffer, bytes.")
      .def_ro("host_unified", &Device::host_unified, "Whether host and device share memory.")
      .def("__str__", &Device::label)
      .def("__repr__",
           [](const Device& device) { return "<broadcl.Device " + device.id() + " " + device.label() + ">"; })
      .def("__eq__", &is_same_device, nb::is_operator(),
           nb::sig("def __eq__(self, other: object, /) -> bool"))
      .def("__getstate__", &state_of)
      .def("__setstate__", &set_state)
      .def("__hash__", [](const Device& device) { return nb::hash(nb::str(device.id().c_str())); });
}

}  // namespace
}  // namespace broadcl::python

NB_MODULE(_core, module) {
  using namespace broadcl::python;
  if (const nb::handle known = nb::type<broadcl::Device>(); known.is_valid()) {
    const auto name = nb::cast<std::string>(known.attr("__module__"));
    throw nb::import_error(("BroadCL is in this process already, as " + name +
                            ", and can be there only once: import that one, and leave it in sys.modules")
                               .c_str());
  }
  if (PyInterpreterState_GetID(PyInterpreterState_Get()) != 0) {
    throw nb::import_error("broadcl works in the main interpreter only; start another process");
  }
  module.doc() = "The C++ core of BroadCL.";
  add_errors(module);
  add_inverted_boxes(module);
  add_device(module);
  add_broad_phase(module);
  add_device_array(module);
  add_device_broad_phase(module);
  module.attr("version") = BROADCL_VERSION_STRING;
  module.attr("NO_BODY") = broadcl::Filter::no_body;
  module.attr("ALL_WORLDS") = broadcl::Filter::all_worlds;
  add_searches(module);
  add_pair_rules(module);
  module.def("devices", with_keywords("devices", &all_devices), nb::sig("def devices() -> list[Device]"),
             R"(Lists the OpenCL devices that can be used.

Returns
-------
list of Device
    In the order of ``clinfo -l``; empty without an OpenCL driver.

Raises
------
Error
    If there are devices, but none is usable.

Examples
--------
>>> gpus = [device for device in broadcl.devices() if device.type == "gpu"])");
  module.def("select_device", with_keywords("select_device", &choose_device), "selector"_a = nb::none(),
             "unknown"_a, nb::sig("def select_device(selector: str | Device | None = None) -> Device"),
             R"(Returns the device that a selector chooses.

Parameters
----------
selector : str or Device, optional
    ``"P:D"`` as numbered by ``clinfo -l``; ``"gpu"``, ``"cpu"`` or ``"accelerator"``; a part of
    "platform / name"; or an element of `devices`. None for the environment variable
    ``BROADCL_DEVICE``, otherwise the best GPU, otherwise the best CPU.

Returns
-------
Device
    The device, which is not opened.

Raises
------
Error
    If no device matches, or if there is none. The text says what to install.

Examples
--------
>>> best = broadcl.select_device()
>>> broadcl.select_device(best.id) == best
True)");
  module.def("algorithms", with_keywords("algorithms", &algorithm_summaries),
             nb::sig("def algorithms() -> dict[str, str]"),
             R"(Lists the algorithms.

Returns
-------
dict of str to str
    The values for `algorithm`, each with a one-line description.

Examples
--------
>>> "auto" in broadcl.algorithms()
True)");
  module.def("host_algorithms", &host_algorithms, "Lists the algorithms that work without a device.");
  publish(module);
}
