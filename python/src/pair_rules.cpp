#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/broad_phase.hpp>
#include <broadcl/filter.hpp>

#include "arrays.hpp"
#include "classes.hpp"
#include "gil.hpp"
#include "keywords.hpp"
#include "signatures.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

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

}  // namespace

void add_pair_rules(nb::module_& module) {
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
}

}  // namespace broadcl::python
