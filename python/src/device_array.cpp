#include "device_array.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

std::string kind_of(nb::handle object) {
  return nb::cast<std::string>(object.type().attr("__name__"));
}

/// An OpenCL object of pyopencl.
template <class Handle>
Handle to_handle(nb::handle object) {
  return reinterpret_cast<Handle>(nb::cast<std::uintptr_t>(object.attr("int_ptr")));
}

bool is_array(nb::handle object) {
  return nb::hasattr(object, "base_data") && nb::hasattr(object, "strides");
}

bool is_buffer(nb::handle object) {
  return nb::hasattr(object, "int_ptr") && nb::hasattr(object, "get_host_array");
}

bool is_queue(nb::handle object) {
  return nb::hasattr(object, "int_ptr") && nb::hasattr(object, "finish");
}

/// What an array of pyopencl says of itself.
struct Layout {
  explicit Layout(nb::handle array)
      : shape(nb::cast<std::vector<std::size_t>>(array.attr("shape"))),
        strides(nb::cast<std::vector<std::ptrdiff_t>>(array.attr("strides"))),
        dtype(nb::cast<std::string>(nb::str(nb::handle(nb::object(array.attr("dtype")))))),
        text(nb::cast<std::string>(
            nb::str("{} with strides {}").format(array.attr("shape"), array.attr("strides")))) {}

  std::vector<std::size_t> shape;
  std::vector<std::ptrdiff_t> strides;  // bytes
  std::string dtype;
  std::string text;  // of the shape and the strides
};

/// The buffer of an array, null if it has no elements.
cl_mem buffer_of(nb::handle array, const std::string& name) {
  const nb::object data = array.attr("base_data");
  if (data.is_none()) return nullptr;
  if (!nb::hasattr(data, "int_ptr")) {
    throw nb::type_error(
        (name + " must be in an OpenCL buffer, not in " + kind_of(data) + "; copy the array").c_str());
  }
  return to_handle<cl_mem>(data);
}

void refuse_other_queue(nb::handle array, nb::handle queue, const std::string& name) {
  const nb::object own = array.attr("queue");
  if (own.is_none() || to_queue(own) == to_queue(queue)) return;
  throw nb::value_error((name + " must be an array of the same queue; use its with_queue()").c_str());
}

nb::object new_array(nb::handle queue, std::size_t pairs, nb::handle data,
                     nb::handle allocator = nb::none()) {
  const nb::object numpy = nb::module_::import_("numpy");
  const nb::object make = nb::module_::import_("pyopencl.array").attr("Array");
  return make(queue, nb::make_tuple(pairs, 2), numpy.attr("uint32"), "data"_a = data,
              "allocator"_a = allocator);
}

nb::object to_buffer(cl_mem buffer) {
  const nb::object from = nb::module_::import_("pyopencl").attr("MemoryObject").attr("from_int_ptr");
  return from(reinterpret_cast<std::uintptr_t>(buffer), "retain"_a = true);
}

}  // namespace

bool is_on_device(nb::handle object) {
  return is_array(object) || is_buffer(object);
}

cl_command_queue to_queue(nb::handle queue) {
  if (!is_queue(queue)) {
    throw nb::type_error(("queue must be a pyopencl.CommandQueue, not " + kind_of(queue)).c_str());
  }
  return to_handle<cl_command_queue>(queue);
}

nb::object queue_of(nb::handle boxes, nb::handle queue) {
  if (!queue.is_none() && !is_queue(queue)) {
    throw nb::type_error(
        ("for boxes on a device, device must be a pyopencl.CommandQueue or None, not " + kind_of(queue))
            .c_str());
  }
  if (!queue.is_none()) return nb::borrow(queue);
  const nb::object own = nb::getattr(boxes, "queue", nb::none());
  if (own.is_none()) {
    throw nb::value_error(
        "a buffer, or an array without a queue, does not say where to work; give device=queue");
  }
  return own;
}

DeviceBoxes::DeviceBoxes(nb::handle boxes, nb::handle queue, const std::string& name) {
  if (!is_on_device(boxes)) {
    throw nb::type_error((name + " must be a pyopencl array or buffer, not " + kind_of(boxes) +
                          "; pyopencl.array.to_device() makes one")
                             .c_str());
  }
  if (!is_array(boxes)) {
    const auto bytes = nb::cast<std::size_t>(boxes.attr("size"));
    if (bytes % sizeof(Aabb) != 0) {
      throw nb::value_error((name + " must be a buffer of 24 bytes for each box, (n, 6) float32, not of " +
                             std::to_string(bytes) + " bytes")
                                .c_str());
    }
    buffer = to_handle<cl_mem>(boxes);
    count = bytes / sizeof(Aabb);
    return;
  }
  refuse_other_queue(boxes, queue, name);
  const Layout layout(boxes);
  if (layout.dtype != "float32") {
    throw nb::type_error((name + " must be float32 on a device, not " + layout.dtype).c_str());
  }
  constexpr std::ptrdiff_t number = sizeof(float);
  const auto& [shape, strides, dtype, text] = layout;
  const bool is_rows = shape.size() == 2 && shape[1] == 6 && strides[1] == number;
  const bool is_corners =
      shape.size() == 3 && shape[1] == 2 && shape[2] == 3 && strides[1] == 3 * number && strides[2] == number;
  if (!shape.empty() && shape[0] == 0) {
    const nb::object cl = nb::module_::import_("pyopencl");
    stand_in = cl.attr("Buffer")(queue.attr("context"), cl.attr("mem_flags").attr("READ_ONLY"), sizeof(Aabb));
    buffer = to_handle<cl_mem>(stand_in);
    return;
  }
  if ((!is_rows && !is_corners) || strides[0] < 0 || (strides[0] == 0 && shape[0] > 1)) {
    throw nb::value_error(
        (name +
         " must be of shape (n, 6) or (n, 2, 3) on a device, with the numbers of a box side "
         "by side and a positive stride; not " +
         text)
            .c_str());
  }
  buffer = buffer_of(boxes, name);
  count = shape[0];
  offset = nb::cast<std::size_t>(boxes.attr("offset"));
  stride = static_cast<std::size_t>(strides[0]);
}

cl_mem to_filters(nb::handle filters, nb::handle queue, std::size_t count) {
  if (filters.is_none()) return nullptr;
  if (is_buffer(filters)) return to_handle<cl_mem>(filters);
  if (!is_array(filters)) {
    throw nb::type_error(("filters must be a pyopencl array or buffer, not " + kind_of(filters)).c_str());
  }
  refuse_other_queue(filters, queue, "filters");
  const Layout layout(filters);
  const std::vector<std::size_t> shape = {count, 4};
  const std::vector<std::ptrdiff_t> strides = {16, 4};
  const bool is_whole = nb::cast<std::size_t>(filters.attr("offset")) == 0;
  if (layout.dtype != "uint32" || layout.shape != shape || (count > 1 && layout.strides != strides) ||
      !is_whole) {
    throw nb::value_error(("filters must be uint32 of shape (" + std::to_string(count) +
                           ", 4), contiguous and at the start of a buffer: group, mask, body, world of each "
                           "box; not " +
                           layout.dtype + " of shape " + layout.text)
                              .c_str());
  }
  return buffer_of(filters, "filters");
}

nb::object show_on_device(const DeviceBroadPhase::PairBuffer& pairs, nb::handle queue) {
  if (pairs.count == 0) return new_array(queue, 0, nb::none());
  return new_array(queue, pairs.count, to_buffer(pairs.buffer));
}

nb::object make_memory_pool(nb::handle queue) {
  const nb::object tools = nb::module_::import_("pyopencl.tools");
  return tools.attr("MemoryPool")(tools.attr("ImmediateAllocator")(queue), "leading_bits_in_bin_id"_a = 1);
}

nb::object copy_on_device(const DeviceBroadPhase::PairBuffer& pairs, nb::handle queue, nb::handle pool) {
  nb::object copy = new_array(queue, pairs.count, nb::none(), pool);
  if (pairs.count == 0) return copy;
  const nb::object enqueue = nb::module_::import_("pyopencl").attr("enqueue_copy");
  const nb::object event = enqueue(queue, copy.attr("base_data"), to_buffer(pairs.buffer),
                                   "byte_count"_a = pairs.count * sizeof(Pair));
  copy.attr("add_event")(event);
  return copy;
}

}  // namespace broadcl::python
