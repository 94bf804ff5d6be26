#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cstdint>

#include "classes.hpp"
#include "keywords.hpp"
#include "objects.hpp"
#include "query.hpp"
#include "signatures.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {

// NOLINTNEXTLINE(readability-function-size): a table
void add_queries(nb::class_<Objects>& objects) {
  objects
      .def("partners", with_keywords("partners", &Objects::partners), "id"_a = nb::none(), "unknown"_a,
           nb::sig("def partners(self, id: int) -> numpy.typing.NDArray[numpy.uint32]"),
           R"(Returns the ids of the objects that are in a pair with this one, as of the last update.

The first call after an update passes once over the pairs and keeps 4 bytes for each partner, until
`shrink`; further ones take as long as there are partners. Several threads may call this at the same time.

Parameters
----------
id : int
    An id.

Returns
-------
numpy.ndarray
    ``(k,)`` uint32, ascending, owned by the caller.

Raises
------
ValueError
    For an unknown id.
Error
    Between `begin` and `finish`.)")
      .def("overlapping", with_keywords("overlapping", &Objects::find<Verb::overlapping>),
           "boxes"_a = nb::none(), nb::kw_only(), "group"_a = nb::none(), "mask"_a = nb::none(),
           "body"_a = nb::none(), "world"_a = nb::none(), "limit"_a = nb::none(), "except_"_a = nb::none(),
           "most_hits"_a = std::uint64_t{1} << 31U, "count_only"_a = false, "within"_a = nb::none(),
           "layout"_a = "min max", "unknown"_a,
           nb::sig("def overlapping(self, boxes: " BOXES ", *, " FILTERS ", " LIMITS
                   ", within: float | None = None, layout: str = 'min max') -> " HITS),
           R"(Finds, for each of some boxes, the objects that overlap or touch it, or are near it.

Objects have the boxes that are set now, also between `begin` and `finish`; no update is needed before,
and none is done. An object that asks with its own box finds itself, unless it is excepted. Exclusions
do not matter. Empty boxes find nothing, and are never found. The host does this, whatever does the updates.

Several threads may call this at the same time. The GIL is released.

Parameters
----------
boxes : array_like or tuple
    One query each: boxes as for `overlapping_pairs`, in host memory. One box without the first
    dimension is a batch of one.
group, mask, body, world : int or array_like of int, optional
    The filters with which the queries ask, one for all or one for each: they find what may pair with an
    object that has this filter. What is left out gets the default value of `add`; if all are left
    out, everything is found.
limit : int, optional
    How many objects each query finds at most: those with the lowest ids.
except_ : array_like of int, optional
    For each query the id of an object that it does not find, such as its own. Ids that no object has
    exclude nothing.
most_hits : int
    How much all queries together may find. If it is more, this raises before memory is exhausted.
count_only : bool
    Whether only the offsets are wanted.
within : float, optional
    The reach with which the queries ask: they find what would pair with an object that has their box
    and this reach. If it is left out, 0: what overlaps, touches or reaches to it.
layout : str
    As for `overlapping_pairs`.

Returns
-------
offsets : numpy.ndarray
    ``(n + 1,)`` uint64, owned by the caller: ``ids[offsets[k]:offsets[k + 1]]`` are those of query k.
ids : numpy.ndarray
    ``(m,)`` uint32, owned by the caller: of each query in ascending order. Empty if they were only counted.

Raises
------
ValueError
    For a NaN (the text names the row), a wrong shape, another number of filters or exceptions, and a
    distance that is negative, NaN or greater than 2^62.
TypeError
    For another dtype or kind of object.
Error
    For more than `most_hits`.
MemoryError
    If memory runs out.)")
      .def("nearest", with_keywords("nearest", &Objects::find<Verb::nearest>), "boxes"_a = nb::none(),
           nb::kw_only(), "group"_a = nb::none(), "mask"_a = nb::none(), "body"_a = nb::none(),
           "world"_a = nb::none(), "limit"_a = nb::none(), "except_"_a = nb::none(),
           "most_hits"_a = std::uint64_t{1} << 31U, "count_only"_a = false, "within"_a = nb::none(),
           "layout"_a = "min max", "unknown"_a,
           nb::sig("def nearest(self, boxes: " BOXES ", *, " FILTERS ", " LIMITS
                   ", within: float | None = None, layout: str = 'min max') -> " RANKED_HITS),
           R"(Finds, for each of some boxes, the objects that are nearest to it.

`set_reach` defines the distance. It is that of the boxes themselves; reaches do not matter. A box that
overlaps the query is at distance 0. Otherwise as `overlapping`.

Parameters
----------
boxes : array_like or tuple
    One query each, as for `overlapping`.
limit : int, optional
    How many objects each query finds at most: those with the least distance, and of those at the same
    distance the ones with the lowest ids.
within : float, optional
    How far away objects may be; if it is left out, at any distance.
group, mask, body, world, except_, most_hits, count_only, layout
    As for `overlapping`.

Returns
-------
offsets : numpy.ndarray
    ``(n + 1,)`` uint64, as of `overlapping`.
ids : numpy.ndarray
    ``(m,)`` uint32: of each query by distance, then by id. Empty if they were only counted.
squared_distances : numpy.ndarray
    ``(m,)`` float64: of each id, in the precision of the `dtype`.

Raises
------
ValueError, TypeError, Error, MemoryError
    As `overlapping` does.)")
      .def(
          "along", with_keywords("along", &Objects::along), "starts"_a = nb::none(),
          "directions"_a = nb::none(), "lengths"_a = nb::none(), nb::kw_only(), "group"_a = nb::none(),
          "mask"_a = nb::none(), "body"_a = nb::none(), "world"_a = nb::none(), "limit"_a = nb::none(),
          "except_"_a = nb::none(), "most_hits"_a = std::uint64_t{1} << 31U, "count_only"_a = false,
          "layout"_a = "min max", "unknown"_a,
          nb::sig("def along(self, starts: " BOXES
                  ", directions: numpy.typing.ArrayLike, lengths: numpy.typing.ArrayLike | None = None, "
                  "*, " FILTERS ", " LIMITS ", layout: str = 'min max') -> " RANKED_HITS),
          R"(Finds, for each of some boxes that move in a straight line, the objects that it meets on its way.

A box moves from its start by t times its direction, for all t from 0 to its length; a ray is a box of
no size. It meets an object at the first t at which they overlap or touch, its time: 0 if they do so at
the start. The chapter "Rays and nearest" defines how times are rounded. Reaches do not matter.
Otherwise as `overlapping`.

Parameters
----------
starts : array_like or tuple
    Boxes as for `overlapping`, finite or empty; those meet nothing. For rays, give points and
    ``layout="points"``.
directions : array_like of float
    ``(n, 3)``, or ``(3,)`` for all; ``(n, 2)`` or ``(2,)`` in two dimensions. Finite, of any length;
    rounded to the `dtype`. With 0, objects are found that the start overlaps.
lengths : float or array_like of float, optional
    In multiples of the directions: one for all, or ``(n,)``. If it is left out, infinite.
limit : int, optional
    How many objects each query finds at most: those that it meets first, and of those that it meets at
    the same time the ones with the lowest ids.
group, mask, body, world, except_, most_hits, count_only, layout
    As for `overlapping`.

Returns
-------
offsets : numpy.ndarray
    ``(n + 1,)`` uint64, as of `overlapping`.
ids : numpy.ndarray
    ``(m,)`` uint32: of each query by time, then by id. Empty if they were only counted.
times : numpy.ndarray
    ``(m,)`` float64: when each is met, in multiples of the direction, in the precision of the `dtype`.

Raises
------
ValueError
    Also for an infinite start, a direction that is infinite or NaN, a length that is negative or NaN,
    and another number of either.
TypeError, Error, MemoryError
    As `overlapping` does.)");
}

}  // namespace broadcl::python
