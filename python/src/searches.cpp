#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/broad_phase.hpp>

#include "arrays.hpp"
#include "box_array.hpp"
#include "classes.hpp"
#include "config.hpp"
#include "device_arrays.hpp"
#include "gil.hpp"
#include "inverted_boxes.hpp"
#include "keywords.hpp"
#include "query.hpp"
#include "signatures.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
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

}  // namespace

void add_searches(nb::module_& module) {
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
}

}  // namespace broadcl::python
