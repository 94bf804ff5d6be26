#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <broadcl/version.h>
#include <broadcl/broad_phase.hpp>
#include <broadcl/filter.hpp>

#include "arrays.hpp"
#include "box_array.hpp"
#include "classes.hpp"
#include "config.hpp"
#include "device_arrays.hpp"
#include "functions.hpp"
#include "gil.hpp"
#include "inverted_boxes.hpp"
#include "keywords.hpp"
#include "query.hpp"
#include "signatures.hpp"

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

void refuse_other_dimensions(const BoxArray& a, const BoxArray& b) {
  if (a.dimensions() == 0 || b.dimensions() == 0 || a.dimensions() == b.dimensions()) return;
  throw nb::value_error((a.name() + " has boxes in " + std::to_string(a.dimensions()) + " dimensions and " +
                         b.name() + " in " + std::to_string(b.dimensions()) +
                         "; give both in the same number of dimensions")
                            .c_str());
}

/// Does something with boxes of the caller, without the GIL. The message for a NaN names its row.
template <class Function>
auto or_name_row(const BoxArray& first, const BoxArray* second, const Function& function) {
  try {
    const GilReleased released;
    return function();
  } catch (const Error& error) {
    const bool may_be_nan = error.kind() == ErrorKind::invalid_argument;
    if (may_be_nan) first.refuse_nan();
    if (may_be_nan && second != nullptr) second->refuse_nan();
    throw;
  }
}

nb::object find_pairs(nb::handle a, nb::handle b, nb::handle exclusions, const Selector& device,
                      const std::string& algorithm, std::size_t threads, const std::string& layout,
                      nb::handle distance, const nb::kwargs& unknown) {
  if (is_on_device(a)) throw nb::next_overload();
  refuse_unknown("overlapping_pairs", unknown);
  double apart = 0;  // (as a parameter, it would accept integers only if there were no other overload)
  if (!nb::try_cast(distance, apart)) throw nb::type_error("distance must be a number");
  const Config config = to_config(device, algorithm, threads, false, apart);
  const BoxArray first(a, b.is_none() ? "boxes" : "a", layout);
  std::optional<BoxArray> second;
  if (!b.is_none()) second.emplace(b, "b", layout);
  if (second) refuse_other_dimensions(first, *second);
  const std::vector<Pair> without = to_exclusions(
      exclusions, first.view().size(), second ? std::optional(second->view().size()) : std::nullopt);
  if (second) {
    warn_of_inverted({&first, &*second});
  } else {
    warn_of_inverted({&first});
  }
  return to_array(or_name_row(first, second ? &*second : nullptr, [&] {
    return second ? overlapping_pairs(first.view(), second->view(), without, config)
                  : overlapping_pairs(first.view(), without, config);
  }));
}

/// The overload for arrays on a device. Arguments that the other overload does not accept come here, too.
nb::object find_pairs_on_device(nb::handle a, nb::handle b, nb::handle exclusions, nb::handle device,
                                const std::string& algorithm, const nb::kwargs& unknown) {
  if (!is_on_device(a)) {
    throw nb::type_error(
        "device must be a string, an element of devices() or None (a pyopencl queue or a CUDA device works "
        "only for arrays there), threads an integer from 0 on, and layout a string");
  }
  refuse_unknown("for boxes on a device, overlapping_pairs", unknown);
  return find_on_device(a, b, exclusions, device, algorithm);
}

/// Finds what an object with these boxes would find.
/// @param search Gets the queries' options and the configuration.
template <class Search>
nb::tuple hits_of(const BoxArray& boxes, const BoxArray& queries, std::optional<std::uint32_t> limit,
                  nb::handle except, std::uint64_t most_hits, bool count_only, std::optional<double> within,
                  std::size_t threads, Verb verb, const Search& search) {
  refuse_other_dimensions(boxes, queries);
  const nb::none all;
  const Query query(all, all, all, all, limit, except, most_hits, count_only, within, queries.view().size());
  warn_of_inverted({&boxes, &queries});
  return to_arrays(
      or_name_row(boxes, &queries, [&] { return search(query.options(), Config{.threads = threads}); }),
      verb);
}

/// overlapping() or nearest().
template <Verb verb>
nb::tuple find_hits(nb::handle boxes, nb::handle queries, std::optional<std::uint32_t> limit,
                    nb::handle except, std::uint64_t most_hits, bool count_only, std::optional<double> within,
                    std::size_t threads, const std::string& layout) {
  const BoxArray first(boxes, "boxes", layout);
  const BoxArray second(queries, "queries", layout);
  return hits_of(first, second, limit, except, most_hits, count_only, within, threads, verb,
                 [&](const QueryOptions& options, const Config& config) {
                   return verb == Verb::nearest ? nearest(first.view(), second.view(), options, config)
                                                : overlapping(first.view(), second.view(), options, config);
                 });
}

nb::tuple find_along(nb::handle boxes, nb::handle starts, nb::handle directions, nb::handle lengths,
                     std::optional<std::uint32_t> limit, nb::handle except, std::uint64_t most_hits,
                     bool count_only, std::size_t threads, const std::string& layout) {
  const BoxArray first(boxes, "boxes", layout);
  const BoxArray second(starts, "starts", layout);
  const Ways ways = to_ways(directions, lengths, second);
  return hits_of(first, second, limit, except, most_hits, count_only, {}, threads, Verb::along,
                 [&](const QueryOptions& options, const Config& config) {
                   return along(first.view(), second.view(), ways.directions, ways.lengths, options, config);
                 });
}

nb::object find_distances_between(nb::handle a, nb::handle b, nb::handle pairs, const std::string& layout) {
  const BoxArray first(a, b.is_none() ? "boxes" : "a", layout);
  std::optional<BoxArray> second;
  if (!b.is_none()) second.emplace(b, "b", layout);
  if (second) refuse_other_dimensions(first, *second);
  const PairArray array(pairs, "pairs");
  const std::span<const Pair> of = array.all();
  std::vector<double> distances;
  {
    const GilReleased released;
    distances =
        second ? squared_distances(first.view(), second->view(), of) : squared_distances(first.view(), of);
  }
  return to_array(std::move(distances));
}

nb::object find_distances(nb::handle boxes, nb::handle pairs, const std::string& layout) {
  return find_distances_between(boxes, nb::none(), pairs, layout);
}

nb::object find_sharing(nb::handle a, nb::handle b) {
  const Words first = Words::of_table(a, "a", 0);
  std::optional<Words> second;
  if (!b.is_none()) second = Words::of_table(b, "b", 0);
  std::vector<Pair> pairs;
  {
    const GilReleased released;
    pairs = second ? pairs_that_share(first.all(), first.columns(), second->all(), second->columns())
                   : pairs_that_share(first.all(), first.columns());
  }
  return to_array(std::move(pairs));
}

/// The groups and the masks.
nb::tuple to_arrays(const std::vector<Filter>& filters) {
  std::vector<std::uint32_t> groups;
  std::vector<std::uint32_t> masks;
  for (const Filter& filter : filters) {
    groups.push_back(filter.group);
    masks.push_back(filter.mask);
  }
  return nb::make_tuple(to_array(std::move(groups)), to_array(std::move(masks)));
}

nb::tuple make_filters_from_layers(nb::handle matrix) {
  refuse_masked(matrix, "matrix");
  const nb::object numpy = nb::module_::import_("numpy");
  const nb::object flags = numpy.attr("ascontiguousarray")(matrix, "dtype"_a = "bool");
  nb::ndarray<const bool, nb::ndim<2>, nb::c_contig, nb::device::cpu> pairs;
  if (!nb::try_cast(flags, pairs) || pairs.shape(0) != pairs.shape(1)) {
    throw nb::value_error((std::string("matrix must be of shape (n, n), not ") +
                           nb::str(nb::handle(flags.attr("shape"))).c_str())
                              .c_str());
  }
  return to_arrays(
      filters_from_layers(pairs.shape(0), [&](std::size_t a, std::size_t b) { return pairs(a, b); }));
}

nb::tuple make_filters_from_one_sided(nb::handle types, nb::handle affinities) {
  const Words of_types(types, "types", {.is_bits = true});
  const Words of_affinities(affinities, "affinities", {.is_bits = true});
  return to_arrays(filters_from_one_sided(of_types.all(), of_affinities.all()));
}

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
  module.def("overlapping_pairs", &find_pairs, "a"_a = nb::none(), "b"_a = nb::none(), nb::kw_only(),
             "exclusions"_a = nb::none(), "device"_a = nb::none(), "algorithm"_a = "auto", "threads"_a = 0,
             "layout"_a = "min max", "distance"_a = 0, "unknown"_a,
             nb::sig("def overlapping_pairs(a: " BOXES ", b: " BOXES
                     " | None = None, *, exclusions: numpy.typing.ArrayLike | None = None, "
                     "device: str | Device | None = None, algorithm: str = 'auto', threads: int = 0, "
                     "layout: str = 'min max', distance: float = 0) -> " ARRAY("uint32")),
             R"(Finds all overlapping pairs of boxes, or all that are within a distance.

With two sets, finds all pairs of a box of `a` and a box of `b`; nothing is tested inside a set.
Any number of threads may call this at the same time; the GIL is released.

Parameters
----------
a, b : array_like or tuple
    Boxes, float32 or float64, in the caller's unit of length, in one of these forms:

    - ``(n, 6)``: lower x, y, z, upper x, y, z;
    - ``(n, 2, 3)``: lower and upper corners;
    - ``(lower, upper)``: a tuple of two arrays ``(n, 3)``;
    - ``(n, 4)``: lower x, y, upper x, y, for boxes in two dimensions.

    NumPy arrays, and other objects with the buffer protocol or DLPack, are read where they are,
    with any strides. Nothing may write to them during the call. These are copied first: lists;
    integers, which are taken as float64; other layouts than ``"min max"``; memory that is
    misaligned or in the other byte order; ``(n, 4)`` arrays whose columns are not
    adjacent; lower and upper corners of different types or strides; one box that is repeated.

    Boxes are closed, so boxes that touch overlap. Bounds may be infinite. A box with lower > upper
    is empty and overlaps nothing; there is an `InvertedBoxesWarning` for such boxes, except for
    `EMPTY`. The pairs of float64 boxes are those that overlap as float64;
    convert the array to float32 for those that overlap as float32.

    Boxes in tensors of CUDA, or in pyopencl arrays or buffers, are searched on their device, as
    `DeviceBroadPhase` does. They must be float32, ``(n, 6)`` or ``(n, 2, 3)``, the numbers of each box
    without gaps. There is no warning for them.
exclusions : array_like of int, optional
    ``(k, 2)``, in host memory: pairs that are not reported, in any order. They are given as the
    rows of the result are. `pairs_that_share` lists those of a mesh.
device : str, Device, or for boxes on a device that of a DeviceBroadPhase, optional
    A selector as for `select_device`. The device stays open for later calls, but its memory is
    freed, so for frequent searches keep a `BroadPhase`. Algorithms of the host open no device, and ``"auto"`` opens only a CPU that
    is named, here or by the environment variable ``BROADCL_DEVICE``.

    For boxes on a device, the queue to work in, which must be in order, or the CUDA device; None for
    that of `a`.
    Kernels are prepared in each call, so for frequent searches keep a `DeviceBroadPhase`.
algorithm : str
    A key of `algorithms`.
threads : int
    Number of threads that an algorithm of the host may use; 0 for one per processor. Not for boxes
    on a device.
layout : str
    What the numbers of each box are; in two dimensions without z. Not for boxes on a device.

    - ``"min max"``: lower x, y, z, upper x, y, z;
    - ``"axes"``: lower x, upper x, lower y, upper y, lower z, upper z, in ``(n, 6)`` or ``(n, 4)``;
    - ``"centre size"``: centre x, y, z, size x, y, z, also in ``(n, 2, 3)`` and a tuple;
    - ``"centre half size"``: the same with half of the size. Corners are computed in float64.
    - ``"points"``: x, y, z, boxes of no size, in ``(n, 3)``, or ``(n, 2)`` in two dimensions.
distance : float
    How far apart the boxes of a pair may be: see `BroadPhase.set_reach`, which defines the distance.
    `squared_distances` returns the distances. Not for boxes on a device.

Returns
-------
numpy.ndarray, pyopencl.array.Array or DeviceArray
    ``(m, 2)`` uint32, owned by the caller: rows (i, j) with i < j or, with two sets, (index in `a`,
    index in `b`). They are in canonical order: sorted by j, then by i. For boxes on a device, the
    pairs stay there (int32 in a `DeviceArray`); ``get()`` copies them to NumPy.

Raises
------
ValueError
    For a NaN (the text names the row), a wrong shape, two sets in a different number of dimensions,
    integers beyond 2^53, masked values, an exclusion of a box and itself or of a box that does not
    exist, or an unknown algorithm or layout.
TypeError
    For another dtype or kind of object.
Error
    If the device fails.
MemoryError
    If memory runs out.

Examples
--------
>>> boxes = [[0, 0, 2, 2], [1, 1, 3, 3], [5, 5, 6, 6]]
>>> broadcl.overlapping_pairs(boxes).tolist()
[[0, 1]]
>>> broadcl.overlapping_pairs(boxes, [[2, 2, 5, 5]]).tolist()    # closed: boxes that touch overlap
[[0, 0], [1, 0], [2, 0]])");
  module.def(
      "overlapping_pairs", &find_pairs_on_device, "a"_a = nb::none(), "b"_a = nb::none(), nb::kw_only(),
      "exclusions"_a = nb::none(), "device"_a = nb::none(), "algorithm"_a = "auto", "unknown"_a,
      nb::sig(
          "def overlapping_pairs(a: pyopencl.array.Array | pyopencl.Buffer | DeviceArray, b: "
          "pyopencl.array.Array | pyopencl.Buffer | DeviceArray | None = None, *, exclusions: "
          "numpy.typing.ArrayLike | None = None, device: object | None = None, algorithm: str = 'auto') -> "
          "pyopencl.array.Array | DeviceArray"));
  module.def("overlapping", with_keywords("overlapping", &find_hits<Verb::overlapping>),
             "boxes"_a = nb::none(), "queries"_a = nb::none(), nb::kw_only(), "limit"_a = nb::none(),
             "except_"_a = nb::none(), "most_hits"_a = std::uint64_t{1} << 31U, "count_only"_a = false,
             "within"_a = nb::none(), "threads"_a = 0, "layout"_a = "min max", "unknown"_a,
             nb::sig("def overlapping(boxes: " BOXES ", queries: " BOXES ", *, " LIMITS
                     ", within: float | None = None, threads: int = 0, layout: str = 'min max') -> " HITS),
             R"(Finds, for each query, the boxes that overlap or touch it, or are near it.

For frequent queries keep a `BroadPhase`, which keeps what is sorted here in each call. Any number of
threads may call this at the same time; the GIL is released.

Parameters
----------
boxes, queries : array_like or tuple
    Boxes as for `overlapping_pairs`, in host memory. If either are float64, both are compared as
    float64. For boxes and points, give ``(points, points)`` as `queries`.
limit, except_, most_hits, count_only, within
    As for `BroadPhase.overlapping`; `except_` has indices of boxes.
threads : int
    Number of threads; 0 for one per processor.
layout : str
    That of both, as for `overlapping_pairs`.

Returns
-------
offsets, ids : numpy.ndarray
    As `BroadPhase.overlapping` returns them; ids are indices of boxes.

Raises
------
ValueError, TypeError, Error, MemoryError
    As `BroadPhase.overlapping` does.

Examples
--------
>>> boxes = [[0, 0, 2, 2], [1, 1, 3, 3], [5, 5, 6, 6]]
>>> offsets, ids = broadcl.overlapping(boxes, [[0, 0, 1, 1], [9, 9, 9, 9]])
>>> offsets.tolist(), ids.tolist()                  # two of the first query, none of the second
([0, 2, 2], [0, 1]))");
  module.def(
      "nearest", with_keywords("nearest", &find_hits<Verb::nearest>), "boxes"_a = nb::none(),
      "queries"_a = nb::none(), nb::kw_only(), "limit"_a = nb::none(), "except_"_a = nb::none(),
      "most_hits"_a = std::uint64_t{1} << 31U, "count_only"_a = false, "within"_a = nb::none(),
      "threads"_a = 0, "layout"_a = "min max", "unknown"_a,
      nb::sig("def nearest(boxes: " BOXES ", queries: " BOXES ", *, " LIMITS
              ", within: float | None = None, threads: int = 0, layout: str = 'min max') -> " RANKED_HITS),
      R"(Finds, for each query, the boxes that are nearest to it.

Parameters
----------
boxes, queries, except_, most_hits, count_only, threads, layout
    As for `overlapping`.
limit, within
    As for `BroadPhase.nearest`.

Returns
-------
offsets, ids, squared_distances : numpy.ndarray
    As `BroadPhase.nearest` returns them; ids are indices of boxes.

Raises
------
ValueError, TypeError, Error, MemoryError
    As `BroadPhase.nearest` does.

Examples
--------
>>> points = [[0, 0, 0], [3, 0, 0], [0, 4, 0]]
>>> offsets, ids, squares = broadcl.nearest(points, [[1, 0, 0]], limit=2, layout="points")
>>> ids.tolist(), squares.tolist()
([0, 1], [1.0, 4.0]))");
  module.def(
      "along", with_keywords("along", &find_along), "boxes"_a = nb::none(), "starts"_a = nb::none(),
      "directions"_a = nb::none(), "lengths"_a = nb::none(), nb::kw_only(), "limit"_a = nb::none(),
      "except_"_a = nb::none(), "most_hits"_a = std::uint64_t{1} << 31U, "count_only"_a = false,
      "threads"_a = 0, "layout"_a = "min max", "unknown"_a,
      nb::sig(
          "def along(boxes: " BOXES ", starts: " BOXES
          ", directions: numpy.typing.ArrayLike, lengths: numpy.typing.ArrayLike | None = None, *, " LIMITS
          ", threads: int = 0, layout: str = 'min max') -> " RANKED_HITS),
      R"(Finds, for each of some boxes that move in a straight line, the boxes that it meets on its way.

Parameters
----------
boxes, except_, most_hits, count_only, threads
    As for `overlapping`.
starts, directions, lengths, limit
    As for `BroadPhase.along`. If boxes or starts are float64, everything is computed in float64,
    otherwise in float32.
layout : str
    Of boxes and starts, as for `overlapping_pairs`. For boxes and rays, give ``(points, points)`` as
    `starts`.

Returns
-------
offsets, ids, times : numpy.ndarray
    As `BroadPhase.along` returns them; ids are indices of boxes.

Raises
------
ValueError, TypeError, Error, MemoryError
    As `BroadPhase.along` does.

Examples
--------
>>> boxes = [[2, 0, 0, 3, 1, 1], [6, 0, 0, 7, 1, 1]]
>>> start = np.array([[0.0, 0.5, 0.5]])
>>> offsets, ids, times = broadcl.along(boxes, (start, start), [2, 0, 0])
>>> ids.tolist(), times.tolist()
([0, 1], [1.0, 3.0]))");
  module.def("squared_distances", &find_distances, "boxes"_a, "pairs"_a, nb::kw_only(),
             "layout"_a = "min max",
             nb::sig("def squared_distances(boxes: " BOXES
                     ", pairs: numpy.typing.ArrayLike, *, layout: str = 'min max') -> " ARRAY("float64")),
             R"(Returns the squares of the distances of pairs of boxes.

`BroadPhase.set_reach` defines the distance. Any number of threads may call this at the same time; the
GIL is released.

Parameters
----------
boxes, a, b : array_like or tuple
    Boxes as for `overlapping_pairs`, in host memory.
pairs : array_like of int
    ``(m, 2)``: rows (i, j) of indices in `boxes`, or with two sets (index in `a`, index in `b`), as
    `overlapping_pairs` returns them, whose arrays are not copied.
layout : str
    As for `overlapping_pairs`.

Returns
-------
numpy.ndarray
    ``(m,)`` float64, in the order of the pairs. Computed in float64 if a set is float64, otherwise in
    float32. Infinite if a box is empty or has a NaN.

Raises
------
ValueError
    For an index of no box, and for a wrong shape.
TypeError
    For another dtype or kind of object.
MemoryError
    If memory runs out.

Examples
--------
>>> points = [[0, 0, 0], [3, 4, 0]]
>>> broadcl.squared_distances(points, [[0, 1]], layout="points").tolist()
[25.0])");
  module.def("squared_distances", with_keywords("squared_distances", &find_distances_between),
             "a"_a = nb::none(), "b"_a = nb::none(), "pairs"_a = nb::none(), nb::kw_only(),
             "layout"_a = "min max", "unknown"_a,
             nb::sig("def squared_distances(a: " BOXES ", b: " BOXES
                     ", pairs: numpy.typing.ArrayLike, *, layout: str = 'min max') -> " ARRAY("float64")));
  module.def(
      "pairs_that_share", with_keywords("pairs_that_share", &find_sharing), "a"_a = nb::none(),
      "b"_a = nb::none(), "unknown"_a,
      nb::sig("def pairs_that_share(a: numpy.typing.ArrayLike, b: numpy.typing.ArrayLike | None = None) -> "
              "numpy.typing.NDArray[numpy.uint32]"),
      R"(Finds all pairs of objects that have a label in common.

They serve as the exclusions of `overlapping_pairs` and `BroadPhase.set_exclusions`. With two sets,
finds all pairs of an object of `a` and an object of `b`. Any number of threads may call this at the
same time; the GIL is released.

Parameters
----------
a, b : array_like of int
    ``(n, k)``: the k labels of each object, 0 to 4294967295. For the edges or faces of a mesh, the
    numbers of their vertices, ``(n, 2)`` or ``(n, 3)``; for its vertices,
    ``numpy.arange(n)[:, None]``.

Returns
-------
numpy.ndarray
    ``(m, 2)`` uint32, owned by the caller, in canonical order: rows (i, j) with i < j or, with two
    sets, (index in `a`, index in `b`).

Raises
------
ValueError
    For a wrong shape or a label that is out of range.
TypeError
    For another dtype.
MemoryError
    If memory runs out.

Examples
--------
>>> faces = [[0, 1, 2], [2, 1, 3], [4, 5, 6]]      # by their vertices
>>> broadcl.pairs_that_share(faces).tolist()
[[0, 1]])");
  module.def("filters_from_layers", with_keywords("filters_from_layers", &make_filters_from_layers),
             "matrix"_a = nb::none(), "unknown"_a,
             nb::sig("def filters_from_layers(matrix: numpy.typing.ArrayLike) -> tuple[" ARRAY(
                 "uint32") ", " ARRAY("uint32") "]"),
             R"(Makes groups and masks from a matrix that says which layers pair.

Up to 32 layers are the groups: layer k has the bit k. Of more layers, those that pair with the same
layers share a group.

Parameters
----------
matrix : array_like
    ``(n, n)``, symmetric: whether two layers pair.

Returns
-------
group, mask : numpy.ndarray
    ``(n,)`` uint32, by layer: give ``group=group[layer], mask=mask[layer]`` to `BroadPhase.add`.

Raises
------
ValueError
    For a matrix that is not symmetric, if more than 32 groups would be needed, and for a wrong shape.

Examples
--------
>>> still, moving = 0, 1
>>> group, mask = broadcl.filters_from_layers([[False, True], [True, True]])
>>> layer = np.array([still, still, moving])
>>> broad_phase = broadcl.BroadPhase()
>>> ids = broad_phase.add(np.tile([0, 0, 0, 1, 1, 1], (3, 1)), group=group[layer], mask=mask[layer])
>>> broad_phase.update().added.tolist()
[[0, 2], [1, 2]])");
  module.def(
      "filters_from_one_sided", with_keywords("filters_from_one_sided", &make_filters_from_one_sided),
      "types"_a = nb::none(), "affinities"_a = nb::none(), "unknown"_a,
      nb::sig("def filters_from_one_sided(types: numpy.typing.ArrayLike, affinities: "
              "numpy.typing.ArrayLike) -> tuple[" ARRAY("uint32") ", " ARRAY("uint32") "]"),
      R"(Makes groups and masks of objects of which two pair if either has a type of the other's affinity.

With `group` and `mask`, both would be needed. MuJoCo's contype and conaffinity are such types and
affinities.

Parameters
----------
types : array_like of int
    ``(n,)``: one bit per type of each object.
affinities : array_like of int
    ``(n,)``: one bit per type with which each object pairs.

Returns
-------
group, mask : numpy.ndarray
    ``(n,)`` uint32, by object, for `BroadPhase.add`. There are as many groups as combinations; if these are
    more than 32, those that pair with the same ones share a group.

Raises
------
ValueError
    If more than 32 groups would be needed, and for a wrong shape.
TypeError
    For another dtype.

Examples
--------
>>> contype, conaffinity = [1, 0, 0], [0, 1, 0]      # the second accepts the first
>>> group, mask = broadcl.filters_from_one_sided(contype, conaffinity)
>>> broad_phase = broadcl.BroadPhase()
>>> ids = broad_phase.add(np.tile([0, 0, 0, 1, 1, 1], (3, 1)), group=group, mask=mask)
>>> broad_phase.update().added.tolist()
[[0, 1]])");
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
