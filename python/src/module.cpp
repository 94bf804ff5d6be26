#include <nanobind/nanobind.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/version.h>
#include <broadcl/broad_phase.hpp>

#include "arrays.hpp"
#include "box_array.hpp"
#include "classes.hpp"
#include "config.hpp"
#include "device_array.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {

std::string to_text(const Selector& selector) {
  if (!selector) return {};
  if (const auto* device = std::get_if<Device>(&*selector)) return device->id();
  return std::get<std::string>(*selector);
}

Config to_config(const Selector& device, const std::string& algorithm, std::size_t threads, bool profile) {
  std::string known;
  for (const AlgorithmInfo& row : algorithms()) {
    if (row.name == algorithm) {
      return {.device = to_text(device), .algorithm = algorithm, .threads = threads, .profile = profile};
    }
    known += (known.empty() ? "" : ", ") + std::string(row.name);
  }
  throw nb::value_error(("no algorithm is named '" + algorithm + "'; there are " + known).c_str());
}

namespace {

nb::object find_pairs(nb::handle a, nb::handle b, nb::handle exclusions, const Selector& device,
                      const std::string& algorithm, std::size_t threads) {
  if (is_on_device(a)) throw nb::next_overload();
  const Config config = to_config(device, algorithm, threads);
  const BoxArray first(a, b.is_none() ? "boxes" : "a");
  std::optional<BoxArray> second;
  if (!b.is_none()) second.emplace(b, "b");
  const std::vector<Pair> without = to_exclusions(
      exclusions, first.view().size(), second ? std::optional(second->view().size()) : std::nullopt);
  std::vector<Pair> pairs;
  try {
    const nb::gil_scoped_release released;
    pairs = second ? overlapping_pairs(first.view(), second->view(), config, without)
                   : overlapping_pairs(first.view(), config, without);
  } catch (const Error&) {
    first.refuse_nan();
    if (second) second->refuse_nan();
    throw;
  }
  return to_array(std::move(pairs));
}

/// The overload for what is on a device; whatever the other one does not take comes here, too.
nb::object find_pairs_on_device(nb::handle a, nb::handle b, nb::handle exclusions, nb::handle queue,
                                const std::string& algorithm) {
  if (!is_on_device(a)) {
    throw nb::type_error(
        "device must be a string, a row of devices() or None; a queue of pyopencl only for arrays of "
        "pyopencl");
  }
  return find_on_device(a, b, exclusions, queue, algorithm);
}

nb::object find_sharing(nb::handle a, nb::handle b) {
  const Words first = Words::of_table(a, "a", 0);
  std::optional<Words> second;
  if (!b.is_none()) second = Words::of_table(b, "b", 0);
  std::vector<Pair> pairs;
  {
    const nb::gil_scoped_release released;
    pairs = second ? pairs_that_share(first.all(), first.columns(), second->all(), second->columns())
                   : pairs_that_share(first.all(), first.columns());
  }
  return to_array(std::move(pairs));
}

nb::dict algorithm_summaries() {
  nb::dict result;
  for (const AlgorithmInfo& row : algorithms()) {
    result[nb::str(row.name.data(), row.name.size())] = nb::str(row.summary.data(), row.summary.size());
  }
  return result;
}

std::vector<Device> all_devices() {
  const nb::gil_scoped_release released;
  return devices();
}

Device choose_device(const Selector& selector) {
  const nb::gil_scoped_release released;
  return select_device(to_text(selector));
}

void add_device(nb::module_& module) {
  nb::class_<Device>(module, "Device", "What an OpenCL device reports about itself. Holds no OpenCL object.")
      .def_prop_ro("id", &Device::id, "P:D, the numbers of platform and device as in `clinfo -l`.")
      .def_prop_ro(
          "type", [](const Device& device) { return std::string(to_string(device.type)); },
          "gpu, cpu, accelerator or other.")
      .def_ro("platform_name", &Device::platform_name)
      .def_ro("name", &Device::name)
      .def_ro("version", &Device::version, "Of OpenCL.")
      .def_ro("driver_version", &Device::driver_version)
      .def_ro("compute_units", &Device::compute_units)
      .def_ro("clock_mhz", &Device::clock_mhz, "Highest clock frequency, 0 if the device does not say.")
      .def_ro("memory", &Device::memory, "Global memory, bytes.")
      .def_ro("max_allocation", &Device::max_allocation, "Largest buffer, bytes.")
      .def_ro("host_unified", &Device::host_unified, "Host and device share memory.")
      .def("__str__", &Device::label)
      .def("__repr__", [](const Device& device) {
        return "<broadcl.Device " + device.id() + " " + device.label() + ">";
      });
}

}  // namespace
}  // namespace broadcl::python

NB_MODULE(_core, module) {
  using namespace broadcl::python;
  if (PyInterpreterState_GetID(PyInterpreterState_Get()) != 0) {
    throw nb::import_error("broadcl works in the main interpreter only; start another process");
  }
  module.doc() = "The C++ core of BroadCL.";
  nb::exception<broadcl::Error>(module, "Error", PyExc_RuntimeError).attr("__doc__") =
      "The device, or the driver, cannot do what was asked for. The text says what to do.";
  add_device(module);
  add_broad_phase(module);
  add_device_broad_phase(module);
  module.attr("version") = BROADCL_VERSION_STRING;
  module.attr("NO_BODY") = broadcl::Filter::no_body;
  module.attr("ALL_WORLDS") = broadcl::Filter::all_worlds;
  module.def(
      "overlapping_pairs", &find_pairs, "a"_a.none(), "b"_a = nb::none(), nb::kw_only(),
      "exclusions"_a = nb::none(), "device"_a = nb::none(), "algorithm"_a = "auto", "threads"_a = 0,
      nb::sig("def overlapping_pairs(a: numpy.typing.ArrayLike | tuple[numpy.typing.ArrayLike, "
              "numpy.typing.ArrayLike], b: numpy.typing.ArrayLike | tuple[numpy.typing.ArrayLike, "
              "numpy.typing.ArrayLike] | None = None, *, exclusions: numpy.typing.ArrayLike | None = None, "
              "device: str | Device | None = None, algorithm: str = 'auto', threads: int = 0) -> "
              "numpy.typing.NDArray[numpy.uint32]"),
      "All overlapping pairs of boxes: (m, 2) uint32, rows (i, j), i < j, by j, then by i. With two sets, "
      "all pairs\n"
      "of a box of `a` with a box of `b`: rows (index in a, index in b).\n\n"
      "a, b: float32 or float64 in the host's memory, with any strides: NumPy arrays and whatever else has "
      "the\n"
      "buffer protocol or DLPack, (n, 6) with rows lower x, y, z, upper x, y, z; (n, 2, 3); (n, 4) in two\n"
      "dimensions; or a tuple (lower, upper) of two (n, 3). Read without a copy, except for lists and what "
      "is\n"
      "misaligned. Nothing may write to them meanwhile. Boxes are closed: touching counts. Bounds may be "
      "infinite;\n"
      "a box with lower > upper is empty and overlaps nothing. float64 rounds outward to float32.\n"
      "exclusions: pairs that are not reported, (k, 2) integers, in any order; rows as those that are "
      "found.\n"
      "pairs_that_share() lists those of a mesh.\n"
      "device: as select_device() takes it, opened in each call; None for the host, unless BROADCL_DEVICE "
      "names\n"
      "one. If you call often, keep a BroadPhase.\n"
      "algorithm: a key of algorithms().\n"
      "threads: that an algorithm of the host may use; 0 for as many as there are processors.\n\n"
      "Any number of threads may call it; the GIL is released.\n\n"
      "Raises ValueError for a NaN (it names the row), a wrong shape, an exclusion of a box that is not "
      "there or an\n"
      "unknown algorithm; TypeError for another dtype or kind of object; Error for the device; MemoryError.");
  module.def(
      "overlapping_pairs", &find_pairs_on_device, "a"_a.none(), "b"_a = nb::none(), nb::kw_only(),
      "exclusions"_a = nb::none(), "device"_a = nb::none(), "algorithm"_a = "auto",
      nb::sig("def overlapping_pairs(a: pyopencl.array.Array | pyopencl.Buffer, b: pyopencl.array.Array | "
              "pyopencl.Buffer | None = None, *, exclusions: numpy.typing.ArrayLike | None = None, device: "
              "pyopencl.CommandQueue | None = None, algorithm: str = 'auto') -> pyopencl.array.Array"),
      "The same for boxes that are on a device, in arrays or buffers of pyopencl: float32, (n, 6) or (n, 2, "
      "3), each\n"
      "box without gaps. The pairs stay there, in an array whose get() makes a NumPy array of it.\n\n"
      "exclusions: in the host's memory.\n"
      "device: the queue to work in, in order; None for that of `a`. Kernels are made ready in each call. If "
      "you call\n"
      "often, keep a DeviceBroadPhase.");
  module.def(
      "pairs_that_share", &find_sharing, "a"_a.none(), "b"_a = nb::none(),
      nb::sig("def pairs_that_share(a: numpy.typing.ArrayLike, b: numpy.typing.ArrayLike | None = None) -> "
              "numpy.typing.NDArray[numpy.uint32]"),
      "All pairs of objects that have a label in common, for overlapping_pairs(exclusions=...) and\n"
      "set_exclusions(): (m, 2) uint32, in canonical order. With two sets, all pairs of an object of `a` "
      "with one of\n"
      "`b`.\n\n"
      "a, b: integers 0 to 4294967295, one row per object: if the objects are edges or faces of a mesh, the "
      "numbers of\n"
      "their vertices, (n, 2) or (n, 3); if they are its vertices, numpy.arange(n)[:, None].\n\n"
      "Any number of threads may call it; the GIL is released.\n\n"
      "Raises ValueError for a wrong shape, TypeError for another dtype, MemoryError.");
  module.def(
      "devices", &all_devices,
      "Every OpenCL device that can be used, in the order of `clinfo -l`; empty without an OpenCL driver.\n\n"
      "Raises Error if there are devices, but all fail.");
  module.def(
      "select_device", &choose_device, "selector"_a = nb::none(),
      "The device that a selector picks: P:D, gpu, cpu or accelerator, or a part of platform / name.\n"
      "None: what the environment variable BROADCL_DEVICE says, otherwise the best GPU, otherwise the\n"
      "best CPU.\n\nRaises Error if there is none; it says what to install.");
  module.def("algorithms", &algorithm_summaries, nb::sig("def algorithms() -> dict[str, str]"),
             "The names that `algorithm` takes, each with one line about it.");
}
