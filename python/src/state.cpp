#include "state.hpp"

#include <nanobind/nanobind.h>

#include <cstddef>
#include <span>
#include <string>
#include <tuple>
#include <variant>
#include <vector>

#include <nanobind/stl/tuple.h>

#include "classes.hpp"

namespace nb = nanobind;

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

}  // namespace broadcl::python
