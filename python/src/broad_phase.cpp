#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "classes.hpp"
#include "config.hpp"
#include "keywords.hpp"
#include "objects.hpp"
#include "signatures.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

/// @throws TypeError, ValueError
bool is_float64(nb::handle dtype) {
  if (dtype.is_none()) throw nb::type_error("dtype must be float32 or float64, not None");
  const nb::object type = nb::module_::import_("numpy").attr("dtype");
  const nb::object given = type(dtype);
  const bool is_double = given.equal(type("float64"));
  if (!is_double && !given.equal(type("float32"))) {
    throw nb::value_error(
        (std::string("dtype must be float32 or float64, not ") + nb::str(given).c_str()).c_str());
  }
  return is_double;
}

nb::handle delta;  // the class, which the module owns, and is never unloaded

void add_delta(nb::module_& module) {
  const nb::object type = nb::module_::import_("collections")
                              .attr("namedtuple")("Delta", nb::make_tuple("added", "removed"),
                                                  "module"_a = module.attr("__name__"));
  type.attr("__doc__") = R"(What changed between two updates: ``added, removed = broad_phase.update()``.

``added`` has the pairs that began to overlap, ``removed`` those that ceased to: ``(m, 2)`` uint32, in
canonical order.

Apply ``removed`` first: if an object was removed and a new one got its id in between, the same pair
of ids may be in both. You may keep the arrays for as long as you like. Up to 2,048 pairs are a copy.
A longer array is a view of the core's memory, which is not reused as long as the array exists, and
may be several times as large; copy the arrays if you keep those of many updates.

Examples
--------
>>> broad_phase = broadcl.BroadPhase()
>>> broad_phase.update([[0, 0, 2, 2], [1, 1, 3, 3]])
Delta(added=array([[0, 1]], dtype=uint32), removed=array([], shape=(0, 2), dtype=uint32)))";
  module.attr("Delta") = type;
  delta = type;
}

}  // namespace

nb::object make_delta(nb::object&& added, nb::object&& removed) {
  // What the class itself does, but it would be called as a function of Python.
  static const auto make = reinterpret_cast<newfunc>(PyType_GetSlot(&PyTuple_Type, Py_tp_new));
  const nb::tuple fields = nb::make_tuple(nb::make_tuple(std::move(added), std::move(removed)));
  nb::object result = nb::steal(make(reinterpret_cast<PyTypeObject*>(delta.ptr()), fields.ptr(), nullptr));
  if (!result.is_valid()) throw nb::python_error();
  return result;
}

// NOLINTNEXTLINE(readability-function-size): a table
void add_broad_phase(nb::module_& module) {
  add_delta(module);
  add_state(module);
  nb::class_<Objects> objects(
      module, "BroadPhase",
      R"(Holds a set of moving boxes, and reports at each `update` which pairs began and which ceased to overlap.

The cost of an update depends on how much moved. A call that raises has changed nothing. The GIL is
released during searches. All arrays that are returned may be kept for as long as you like. An object can
be pickled and copied if it can be saved (see `save`): its device is then selected anew, and its first
`update` reports what changes from there.

Parameters
----------
device : str or Device, optional
    A selector as for `select_device`; with None, `algorithm` decides.
algorithm : str
    A key of `algorithms`. ``"auto"`` works on the host or on a GPU, whichever is expected to be
    faster.
threads : int
    Number of threads that an algorithm of the host may use, and that may copy boxes; 0 for one per
    processor.
profile : bool
    Whether to measure stages on the device, too: see the method `profile`.
distance : float
    How far apart the boxes of a pair may be. It is as if each object had half of this as its reach:
    see `set_reach`, which is then refused.
dtype : dtype_like
    Of the boxes, float32 or float64. With float64, pairs and changes are exactly those of boxes in
    double precision, however near or far their bounds; each box takes 48 to 96 bytes more on the
    host. With float32, boxes that are given in float64 are rounded outward.

Raises
------
ValueError
    For an unknown algorithm, another dtype, and a distance that is negative, NaN or greater than 2^63.
TypeError
    For what is no dtype.
Error
    For an unknown device, unless the algorithm is one of the host, and if OpenCL fails.
RuntimeError
    By every method, if another thread is using the object. Only `overlapping`, `nearest`, `along` and
    `partners` may be called by several threads at the same time.

Examples
--------
>>> broad_phase = broadcl.BroadPhase()
>>> ids = broad_phase.add([[0, 0, 2, 2], [1, 1, 3, 3], [5, 5, 6, 6]])
>>> broad_phase.update().added.tolist()
[[0, 1]]
>>> broad_phase.move(2, [2, 2, 4, 4])
>>> broad_phase.remove(0)
>>> added, removed = broad_phase.update()
>>> added.tolist(), removed.tolist()
([[1, 2]], [[0, 1]])
>>> broad_phase.pairs().tolist(), len(broad_phase), 0 in broad_phase
([[1, 2]], 2, False))");
  objects
      .def("__init__",
           with_keywords(
               "BroadPhase",
               +[](Objects* self, const Selector& device, const std::string& algorithm, std::size_t threads,
                   bool profile, nb::handle dtype, double distance) {
                 new (self)
                     Objects(to_config(device, algorithm, threads, profile, distance), is_float64(dtype));
               }),
           nb::kw_only(), "device"_a = nb::none(), "algorithm"_a = "auto", "threads"_a = 0,
           "profile"_a = false, "dtype"_a = "float32", "distance"_a = 0, "unknown"_a,
           nb::sig("def __init__(self, *, device: str | Device | None = None, algorithm: str = \"auto\", "
                   "threads: int = 0, profile: bool = False, dtype: numpy.typing.DTypeLike = \"float32\", "
                   "distance: float = 0) -> None"))
      .def(
          "add", with_keywords("add", &Objects::add), "boxes"_a = nb::none(), nb::kw_only(), "group"_a = 1,
          "mask"_a = 0xffffffffU, "body"_a = Filter::no_body, "world"_a = 0, "reach"_a = 0,
          "layout"_a = "min max", "unknown"_a,
          nb::sig("def add(self, boxes: " BOXES
                  ", *, group: numpy.typing.ArrayLike = 1, mask: numpy.typing.ArrayLike = "
                  "4294967295, body: numpy.typing.ArrayLike = 4294967295, world: numpy.typing.ArrayLike = 0, "
                  "reach: numpy.typing.ArrayLike = 0, layout: str = 'min max') -> int | "
                  "numpy.typing.NDArray[numpy.uint32]"),
          R"(Adds objects and returns their ids.

Parameters
----------
boxes : array_like or tuple
    Boxes as for `overlapping_pairs`, in host memory; one box without the first dimension. Copied.
group, mask : int or array_like of int
    The groups that the object is in, and those with which it pairs: one bit per group. -1 is all
    bits, ``~1`` all but the lowest. Two objects pair only if each is in a group of the other's mask.
body : int or array_like of int
    Objects of the same body never pair; those of `NO_BODY` belong to none.
world : int or array_like of int
    Objects of different worlds never pair; those of `ALL_WORLDS` are in all of them.
reach : float or array_like of float
    How far the objects reach beyond their boxes: see `set_reach`.
layout : str
    As for `overlapping_pairs`.

Returns
-------
int or numpy.ndarray
    The id of one box, otherwise ``(n,)`` uint32. Each is the lowest free id, so ids stay dense and
    depend only on the sequence of calls.

Raises
------
ValueError
    For a NaN (the text names the row), a wrong shape, and a reach that `set_reach` refuses.
TypeError
    For another dtype or kind of object.)")
      .def("move", with_keywords("move", &Objects::move), "ids"_a = nb::none(), "boxes"_a = nb::none(),
           nb::kw_only(), "layout"_a = "min max", "unknown"_a,
           nb::sig("def move(self, ids: numpy.typing.ArrayLike, boxes: " BOXES
                   ", *, layout: str = 'min max') -> None"),
           R"(Replaces the box of one object, or of n objects.

A box that is equal to the old one does not count as movement. A call that raises has moved nothing.

Parameters
----------
ids : int or array_like of int
    One id, or ``(n,)``.
boxes : array_like or tuple
    As many boxes as ids, as for `add`. Copied.
layout : str
    As for `overlapping_pairs`.

Raises
------
ValueError
    For an unknown id, a NaN (the text names the row) or a wrong shape.
TypeError
    For another dtype or kind of object.)")
      .def(
          "set_filter", with_keywords("set_filter", &Objects::set_filter), "ids"_a = nb::none(),
          nb::kw_only(), "group"_a = 1, "mask"_a = 0xffffffffU, "body"_a = Filter::no_body, "world"_a = 0,
          "unknown"_a,
          nb::sig(
              "def set_filter(self, ids: numpy.typing.ArrayLike, *, group: numpy.typing.ArrayLike = 1, mask: "
              "numpy.typing.ArrayLike = 4294967295, body: numpy.typing.ArrayLike = 4294967295, world: "
              "numpy.typing.ArrayLike = 0) -> None"),
          R"(Replaces the whole filter of one object, or of n objects.

Parameters
----------
ids : int or array_like of int
    One id, or ``(n,)``.
group, mask, body, world : int or array_like of int
    As for `add`. What is left out gets its default value. If an id is given twice, the later one counts.

Raises
------
ValueError
    For an unknown id or a wrong shape.
TypeError
    For another dtype.)")
      .def("set_reach", with_keywords("set_reach", &Objects::set_reach), "ids"_a = nb::none(),
           "reaches"_a = nb::none(), "unknown"_a,
           nb::sig(
               "def set_reach(self, ids: numpy.typing.ArrayLike, reaches: numpy.typing.ArrayLike) -> None"),
           R"(Sets how far one object, or n objects, reach beyond their boxes.

Two objects pair if the distance of their boxes is at most the sum of their reaches. Initially a reach
is 0; with a sum of 0, or below 2^-63, boxes have to overlap. Spheres and particles are points with a
reach. A reach that changes counts as movement.

The distance is Euclidean. Along each axis, the gap is lower bound minus upper bound if that is at least
2^-63, otherwise 0; the squares of the three gaps are added in the order of the axes, and the sum is
compared with the square of the sum of the reaches, each step rounded to the nearest number of the
`dtype`. So results are the same on every device.

Parameters
----------
ids : int or array_like of int
    One id, or ``(n,)``.
reaches : float or array_like of float
    One for all, or ``(n,)``. Rounded to the `dtype`.

Raises
------
ValueError
    For an unknown id, a reach that is negative, NaN or greater than 2^62, a wrong shape, and if the
    object has a `distance`.
TypeError
    For another dtype.)")
      .def("set_exclusions", with_keywords("set_exclusions", &Objects::set_exclusions),
           "pairs"_a = nb::none(), "unknown"_a,
           nb::sig("def set_exclusions(self, pairs: numpy.typing.ArrayLike) -> None"),
           R"(Replaces the list of pairs of ids that are never reported.

Initially it is empty.

Parameters
----------
pairs : array_like of int
    ``(m, 2)``, in any order; copied. `pairs_that_share` lists those of a mesh.

Raises
------
ValueError
    For a pair of an id and itself, and for a wrong shape.
TypeError
    For another dtype.)")
      .def("remove", with_keywords("remove", &Objects::remove), "ids"_a = nb::none(), "unknown"_a,
           nb::sig("def remove(self, ids: numpy.typing.ArrayLike) -> None"),
           R"(Removes one object, or n objects.

Their pairs are in `removed` of the next update. Their ids may be given to the next objects added.

Parameters
----------
ids : int or array_like of int
    One id, or ``(n,)``.

Raises
------
ValueError
    For an unknown id, or for one that is given twice.
TypeError
    For another dtype.)")
      .def("shrink", with_keywords("shrink", &Objects::shrink), nb::sig("def shrink(self) -> None"),
           R"(Gives back memory that the present objects and pairs do not need, on host and device.

Nothing does so by itself; call it after an update with far more pairs than usual. Arrays that were
returned stay valid, and keep their memory. Waits for the device.

Raises
------
Error
    Between `begin` and `finish`, and if the device fails.
MemoryError
    If memory runs out.)")
      .def("map", with_keywords("map", &Objects::map), "n"_a = nb::none(), "unknown"_a,
           nb::sig("def map(self, n: int) -> numpy.typing.NDArray[numpy.float32] | "
                   "numpy.typing.NDArray[numpy.float64]"),
           R"(Makes 0 .. n-1 the ids of the objects, and returns their boxes for you to write.

New objects have empty boxes. All objects count as moved. A NaN is a ValueError of the next `update`,
which names the first row; correct it and call `update` again.

Parameters
----------
n : int
    Number of objects.

Returns
-------
numpy.ndarray
    ``(n, 6)`` of the `dtype`: lower x, y, z, upper x, y, z. In float32, it is the memory that the
    device, or an algorithm of the host, reads. The next call that changes or updates anything takes the boxes and
    makes the array read-only; call `map` again for the next frame. Slices that were made from it
    before must not be written afterwards, either. The array keeps its memory alive.

Raises
------
ValueError
    For more than 2,147,483,648 objects.
Error
    Between `begin` and `finish`, and if there is no memory for the boxes.)")
      .def("box", with_keywords("box", &Objects::box), "id"_a = nb::none(), "unknown"_a,
           nb::sig("def box(self, id: int) -> numpy.typing.NDArray[numpy.float32] | "
                   "numpy.typing.NDArray[numpy.float64]"),
           R"(Returns the box of an object, as it will be in the next update.

Parameters
----------
id : int
    An id.

Returns
-------
numpy.ndarray
    ``(6,)`` of the `dtype`, a copy: lower x, y, z, upper x, y, z. An empty box may have other bounds than
    those that were given.

Raises
------
ValueError
    For an unknown id.)")
      .def("filter", with_keywords("filter", &Objects::filter), "id"_a = nb::none(), "unknown"_a,
           nb::sig("def filter(self, id: int) -> dict[str, int]"),
           R"(Returns the filter of an object.

Parameters
----------
id : int
    An id.

Returns
-------
dict of str to int
    ``group``, ``mask``, ``body`` and ``world``, as for `add`.

Raises
------
ValueError
    For an unknown id.)")
      .def("reach", with_keywords("reach", &Objects::reach), "id"_a = nb::none(), "unknown"_a,
           nb::sig("def reach(self, id: int) -> float"),
           R"(Returns the reach of an object; with a `distance`, half of that.

Parameters
----------
id : int
    An id.

Returns
-------
float
    In the precision of the `dtype`.

Raises
------
ValueError
    For an unknown id.)")
      .def("ids", with_keywords("ids", &Objects::ids), "unknown"_a,
           nb::sig("def ids(self) -> " ARRAY("uint32")),
           R"(Returns the ids of all objects.

Returns
-------
numpy.ndarray
    ``(n,)`` uint32, ascending, owned by the caller.

Examples
--------
>>> broad_phase = broadcl.BroadPhase()
>>> ids = broad_phase.add(np.zeros((3, 6)))
>>> broad_phase.remove(1)
>>> broad_phase.ids().tolist()
[0, 2])")
      .def("boxes", with_keywords("boxes", &Objects::boxes), "unknown"_a,
           nb::sig("def boxes(self) -> " ARRAY("float32") " | " ARRAY("float64")),
           R"(Returns the boxes of all objects, as they will be in the next update.

Returns
-------
numpy.ndarray
    ``(n, 6)`` of the `dtype`, owned by the caller, in the order of `ids`: each as `box` returns it.

Examples
--------
>>> broad_phase = broadcl.BroadPhase()
>>> ids = broad_phase.add([[0, 0, 2, 2], [1, 1, 3, 3]])
>>> broad_phase.boxes().tolist()
[[0.0, 0.0, 0.0, 2.0, 2.0, 0.0], [1.0, 1.0, 0.0, 3.0, 3.0, 0.0]])")
      .def("filters", with_keywords("filters", &Objects::filters), "unknown"_a,
           nb::sig("def filters(self) -> dict[str, " ARRAY("uint32") "]"),
           R"(Returns the filters of all objects.

Returns
-------
dict of str to numpy.ndarray
    ``group``, ``mask``, ``body`` and ``world``: ``(n,)`` uint32 each, owned by the caller, in the order of
    `ids`. So ``set_filter(ids(), **filters())`` changes nothing.

Examples
--------
>>> broad_phase = broadcl.BroadPhase()
>>> ids = broad_phase.add(np.zeros((3, 6)), world=[7, 7, 8])
>>> filters = broad_phase.filters()
>>> filters["world"].tolist()
[7, 7, 8]
>>> broad_phase.set_filter(ids, **filters | {"world": 0})
>>> broad_phase.filter(2)["world"]
0)")
      .def("reaches", with_keywords("reaches", &Objects::reaches), "unknown"_a,
           nb::sig("def reaches(self) -> " ARRAY("float32") " | " ARRAY("float64")),
           R"(Returns the reaches of all objects; with a `distance`, half of that for each.

Returns
-------
numpy.ndarray
    ``(n,)`` of the `dtype`, owned by the caller, in the order of `ids`.

Examples
--------
>>> broad_phase = broadcl.BroadPhase()
>>> ids = broad_phase.add([[0, 0, 0], [1, 0, 0]], layout="points", reach=[0.5, 0.25])
>>> broad_phase.reaches().tolist()
[0.5, 0.25])")
      .def("exclusions", with_keywords("exclusions", &Objects::exclusions), "unknown"_a,
           nb::sig("def exclusions(self) -> " ARRAY("uint32")),
           R"(Returns the pairs that `set_exclusions` was given last.

Returns
-------
numpy.ndarray
    ``(m, 2)`` uint32, owned by the caller, in canonical order and each pair once.

Examples
--------
>>> broad_phase = broadcl.BroadPhase()
>>> broad_phase.set_exclusions([[5, 1], [0, 2], [1, 5]])
>>> broad_phase.exclusions().tolist()
[[0, 2], [1, 5]])")
      .def(
          "update", with_keywords("update", &Objects::update), "boxes"_a = nb::none(), nb::kw_only(),
          "layout"_a = "min max", "unknown"_a,
          nb::sig("def update(self, boxes: " BOXES " | None = None, *, layout: str = 'min max') -> Delta"),
          R"(Finds every overlapping pair that the filters allow, and returns what changed since the last update;
with `boxes`, these are first given to all objects, of which those beyond the last box are removed.

The same as `begin` and `finish`. After an exception, the call may be repeated. If there was no
memory for the arrays of the Delta, it then returns that Delta, without another search.

Parameters
----------
boxes : array_like or tuple, optional
    New boxes for all objects, as for `overlapping_pairs`, in host memory: row k becomes the box of
    object k. The ids are then 0 .. n-1: missing objects are added, those beyond row n-1 removed, and
    those that existed keep their filters. Boxes that are the same as before do not count as movement. Copied,
    while a device receives them.
layout : str
    As for `overlapping_pairs`.

Returns
-------
Delta
    ``added`` and ``removed``, pairs of ids.

Raises
------
ValueError
    For a NaN in `boxes` (the text names the row), or one that was written to the array of `map`.
Error
    If the device fails; with `boxes`, also between `begin` and `finish`.
MemoryError
    If memory runs out.)")
      .def(
          "begin", with_keywords("begin", &Objects::begin), "boxes"_a = nb::none(), nb::kw_only(),
          "layout"_a = "min max", "unknown"_a,
          nb::sig("def begin(self, boxes: " BOXES " | None = None, *, layout: str = 'min max') -> None"),
          R"(Starts an update on the device, and returns at once; with `boxes`, objects beyond the last box are removed.

Objects that are added, moved or removed before `finish` belong to the next update. Without boxes, it
is a no-op if an update was started already. On the host, `finish` does all of the work.

Parameters
----------
boxes : array_like or tuple, optional
    As for `update`. You may overwrite them when this returns.
layout : str
    As for `overlapping_pairs`.

Raises
------
ValueError, Error, MemoryError
    As `update` does.)")
      .def("finish", with_keywords("finish", &Objects::finish), nb::sig("def finish(self) -> Delta"),
           R"(Waits for the update that `begin` started, or does one, and returns the changes.

Returns
-------
Delta
    The changes for the objects as they were at `begin`.

Raises
------
ValueError, Error, MemoryError
    As `update` does.)")
      .def("pairs", with_keywords("pairs", &Objects::pairs),
           nb::sig("def pairs(self) -> numpy.typing.NDArray[numpy.uint32]"),
           R"(Returns all pairs as of the last update.

Returns
-------
numpy.ndarray
    ``(m, 2)`` uint32, owned by the caller: rows (a, b) of ids with a < b, in canonical order, that
    is, sorted by b, then by a.

Raises
------
Error
    Between `begin` and `finish`.)")
      .def("profile", with_keywords("profile", &Objects::profile),
           nb::sig("def profile(self) -> dict[str, dict[str, float]]"),
           R"(Returns where the time of the last update on a device went.

Returns
-------
dict of str to dict
    For each stage, ``host_seconds``, which the calling thread spent, and ``device_seconds``, which
    the device spent, if the object was created with ``profile=True``. Empty on the host.)")
      .def_prop_ro("device", &Objects::device,
                   "The `Device` that will do the next update; None for the host.")
      .def_prop_ro(
          "dtype",
          [](const Objects& self) {
            return nb::module_::import_("numpy").attr("dtype")(self.is_in_double() ? "float64" : "float32");
          },
          nb::sig("def dtype(self) -> numpy.dtype[numpy.float32] | numpy.dtype[numpy.float64]"),
          "That of the boxes.")
      .def_prop_ro("algorithm", &Objects::algorithm, "The name of the algorithm.")
      .def_prop_ro("memory", &Objects::memory, nb::sig("def memory(self) -> dict[str, int]"),
                   "OpenCL memory, bytes: ``device``, on the device now; ``device_peak``, the largest value "
                   "of that so\n"
                   "far; ``pinned``, pinned host memory.")
      .def("__len__", &Objects::size, "Number of objects.")
      .def("__contains__", &Objects::contains, nb::sig("def __contains__(self, id: int, /) -> bool"),
           "Whether an object has this id.")
      .def("__repr__", &Objects::text);
  add_queries(objects);
  add_saving(objects);
}

}  // namespace broadcl::python
