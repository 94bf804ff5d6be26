#include "device_arrays.hpp"

#include <nanobind/stl/string.h>

#include <utility>

namespace nb = nanobind;

namespace broadcl::python {

std::string kind_of(nb::handle object) {
  return nb::cast<std::string>(object.type().attr("__name__"));
}

DeviceArraysPointer device_arrays(nb::handle device, bool profile) {
  if (auto arrays = pyopencl_arrays(device)) return arrays;
  if (auto arrays = tensors(device, profile)) return arrays;
  throw nb::type_error(
      ("device must be a pyopencl.CommandQueue, or a CUDA device such as 'cuda:0' or that of "
       "a tensor, not " +
       kind_of(device))
          .c_str());
}

DeviceArraysPointer device_arrays_of(nb::handle boxes, nb::handle device) {
  if (!device.is_none()) return device_arrays(device, false);
  if (!is_pyopencl(boxes)) return device_arrays(boxes, false);
  const nb::object queue = nb::getattr(boxes, "queue", nb::none());
  if (queue.is_none()) {
    throw nb::value_error(
        "a buffer, or an array without a queue, does not say where to work; give device=queue");
  }
  return device_arrays(queue, false);
}

std::string DeviceLayout::text() const {
  const auto tuple = [](const auto& numbers) {
    std::string list;
    for (const auto number : numbers) list += (list.empty() ? "" : ", ") + std::to_string(number);
    return "(" + list + (numbers.size() == 1 ? ",)" : ")");
  };
  return tuple(shape) + " with strides " + tuple(strides);
}

std::size_t DeviceLayout::stride_of_boxes(const std::string& name) const {
  if (dtype != "float32") {
    throw nb::type_error((name + " must be float32 on a device, not " + dtype).c_str());
  }
  constexpr std::ptrdiff_t number = sizeof(float);
  const bool is_rows = shape.size() == 2 && shape[1] == 6 && strides[1] == number;
  const bool is_corners =
      shape.size() == 3 && shape[1] == 2 && shape[2] == 3 && strides[1] == 3 * number && strides[2] == number;
  if (!shape.empty() && shape[0] == 0) return 0;
  if ((!is_rows && !is_corners) || strides[0] < 0 || (strides[0] == 0 && shape[0] > 1)) {
    throw nb::value_error(
        (name +
         " must be of shape (n, 6) or (n, 2, 3) on a device, with the numbers of a box side "
         "by side and a positive stride; not " +
         text())
            .c_str());
  }
  return static_cast<std::size_t>(strides[0]);
}

}  // namespace broadcl::python
