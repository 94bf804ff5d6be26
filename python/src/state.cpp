#include "state.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <cstddef>
#include <span>
#include <string>
#include <tuple>
#include <variant>
#include <vector>

#include "classes.hpp"
#include "keywords.hpp"
#include "objects.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

bool is_in_double(const SavedObjects& saved) {
  return std::holds_alternative<State64>(saved.state);
}

nb::bytes bytes_of(const SavedObjects& saved) {
  const std::vector<std::byte> bytes =
      std::visit([](const auto& state) { return state.bytes(); }, saved.state);
  return nb::bytes(bytes.data(), bytes.size());
}

std::tuple<bool, nb::bytes> pickled(const SavedObjects& saved) {
  return {is_in_double(saved), bytes_of(saved)};
}

void unpickle(SavedObjects& saved, const std::tuple<bool, nb::bytes>& pickled) {
  const auto& [in_double, bytes] = pickled;
  const std::span<const std::byte> data(static_cast<const std::byte*>(bytes.data()), bytes.size());
  in_double ? new (&saved) SavedObjects{State64::from_bytes(data)}
            : new (&saved) SavedObjects{State::from_bytes(data)};
}

}  // namespace

void add_state(nb::module_& module) {
  nb::class_<SavedObjects>(
      module, "State",
      R"(What `BroadPhase.save` returns, for `BroadPhase.restore`; there is no constructor.

It has ids, boxes, filters, reaches and exclusions of all objects, and cannot be changed. It can be
pickled, but only the same version of the package can load that. Any number of threads may use it at
the same time.)")
      .def_prop_ro(
          "dtype",
          [](const SavedObjects& saved) {
            return nb::module_::import_("numpy").attr("dtype")(is_in_double(saved) ? "float64" : "float32");
          },
          nb::sig("def dtype(self) -> numpy.dtype[numpy.float32] | numpy.dtype[numpy.float64]"),
          "The type of the boxes.")
      .def("__repr__",
           [](const SavedObjects& saved) {
             return std::string("<broadcl.State ") + (is_in_double(saved) ? "float64>" : "float32>");
           })
      .def("__copy__", [](nb::handle self) { return nb::borrow(self); })
      .def("__deepcopy__", [](nb::handle self, nb::handle /*known*/) { return nb::borrow(self); })
      .def("__getstate__", &pickled)
      .def("__setstate__", &unpickle);
}

// NOLINTNEXTLINE(readability-function-size): a table
void add_saving(nb::class_<Objects>& objects) {
  objects
      .def("save", with_keywords("save", &Objects::save), "unknown"_a, nb::sig("def save(self) -> State"),
           R"(Saves the objects as of the last update, for `restore`. Nothing is searched.

Returns
-------
State
    Ids, boxes, filters, reaches and exclusions. Each id takes 25 bytes (in float64 49), 16 more with
    filters, 4 (8) with reaches.

Raises
------
Error
    Between `begin` and `finish`, and with changes that no update has reported: call `update` first.
MemoryError
    If memory runs out.

Examples
--------
>>> broad_phase = broadcl.BroadPhase()
>>> broad_phase.update([[0, 0, 2, 2], [1, 1, 3, 3]]).added.tolist()
[[0, 1]]
>>> state = broad_phase.save()
>>> broad_phase.update([[0, 0, 2, 2], [5, 5, 6, 6]]).removed.tolist()
[[0, 1]]
>>> broad_phase.restore(state).added.tolist()
[[0, 1]])")
      .def("restore",
           with_keywords(
               "restore",
               +[](Objects& self, const SavedObjects* state) {
                 if (state == nullptr) throw nb::type_error("the argument 'state' is missing");
                 return self.restore(*state);
               }),
           "state"_a = nb::none(), "unknown"_a, nb::sig("def restore(self, state: State) -> Delta"),
           R"(Makes objects, ids, filters, reaches, exclusions and pairs those of the saved moment.

Changes that no update has reported are dropped. From then on, all results are those of an object that
never went on after `save`. The cost depends on what differs, as in `update`.

Parameters
----------
state : State
    Also that of another object with the same `dtype` and the same `distance`; algorithm, device and
    threads may be others.

Returns
-------
Delta
    What changed since the last update, to be applied to a list of pairs, or dropped if the list goes
    back in another way. A pair that is in both lists of pairs is in neither of these, even if its objects
    were replaced meanwhile.

Raises
------
ValueError
    For a state of another `dtype` or `distance`.
Error
    Between `begin` and `finish`, and if the device fails.
MemoryError
    If memory runs out.)")
      .def("__getstate__", &Objects::pickled)
      .def(
          "__setstate__",
          +[](Objects& self, const Objects::Pickled& pickled) { new (&self) Objects(pickled); });
}

}  // namespace broadcl::python
