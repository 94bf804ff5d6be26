#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>

#include "device_arrays.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

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

DeviceLayout layout_of(nb::handle array) {
  return {.shape = nb::cast<std::vector<std::size_t>>(array.attr("shape")),
          .strides = nb::cast<std::vector<std::ptrdiff_t>>(array.attr("strides")),
          .dtype = nb::cast<std::string>(nb::str(nb::handle(nb::object(array.attr("dtype")))))};
}

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

nb::object to_buffer(cl_mem buffer) {
  const nb::object from = nb::module_::import_("pyopencl").attr("MemoryObject").attr("from_int_ptr");
  return from(reinterpret_cast<std::uintptr_t>(buffer), "retain"_a = true);
}

/// A pool of pyopencl for memory on the device of a queue, with two sizes between each power of two and the
/// next. To allocate a buffer may take longer than an update.
nb::object make_memory_pool(nb::handle queue) {
  const nb::object tools = nb::module_::import_("pyopencl.tools");
  return tools.attr("MemoryPool")(tools.attr("ImmediateAllocator")(queue), "leading_bits_in_bin_id"_a = 1);
}

/// Arrays and buffers of pyopencl, in a queue of the caller.
class PyopenclArrays final : public DeviceArrays {
 public:
  explicit PyopenclArrays(nb::handle queue) : queue_(nb::borrow(queue)), pool_(make_memory_pool(queue)) {}

  cl_command_queue queue() const override { return to_handle<cl_command_queue>(queue_); }
  nb::object callers_queue() const override { return queue_; }

  DeviceBroadPhase::Boxes read(nb::handle first, nb::handle second, nb::handle filters) override {
    const DeviceBroadPhase::SecondSet one = place(first, second.is_none() ? "boxes" : "the first set");
    DeviceBroadPhase::Boxes boxes{
        .buffer = one.buffer, .count = one.count, .offset = one.offset, .stride = one.stride};
    if (!second.is_none()) boxes.second = place(second, "the second set");
    boxes.filters = to_filters(filters, boxes.count + boxes.second.count);
    return boxes;
  }

  nb::object copy(const DeviceBroadPhase::PairBuffer& pairs) override {
    nb::object copy = new_array(pairs.count, nb::none(), pool_);
    if (pairs.count == 0) return copy;
    const nb::object enqueue = nb::module_::import_("pyopencl").attr("enqueue_copy");
    const nb::object event = enqueue(queue_, copy.attr("base_data"), to_buffer(pairs.buffer),
                                     "byte_count"_a = pairs.count * sizeof(Pair));
    copy.attr("add_event")(event);
    return copy;
  }

  nb::object show(const DeviceBroadPhase::PairBuffer& pairs) override {
    return new_array(pairs.count, pairs.count == 0 ? nb::none() : to_buffer(pairs.buffer), nb::none());
  }

  void complete() override {}  // readers use the same queue, or wait for the event

  nb::object make_boxes(std::size_t /*n*/) override {
    throw nb::type_error("arrays of pyopencl are never copied; give any of them to update()");
  }

  void shrink() override { pool_.attr("free_held")(); }

 private:
  void refuse_other_queue(nb::handle array, const std::string& name) const {
    const nb::object own = array.attr("queue");
    if (own.is_none() || to_handle<cl_command_queue>(own) == queue()) return;
    throw nb::value_error((name + " must be an array of the same queue; use its with_queue()").c_str());
  }

  nb::object new_array(std::size_t pairs, nb::handle data, nb::handle allocator) const {
    const nb::object numpy = nb::module_::import_("numpy");
    const nb::object make = nb::module_::import_("pyopencl.array").attr("Array");
    return make(queue_, nb::make_tuple(pairs, 2), numpy.attr("uint32"), "data"_a = data,
                "allocator"_a = allocator);
  }

  /// Where boxes are. Nothing is read.
  DeviceBroadPhase::SecondSet place(nb::handle boxes, const std::string& name) {
    if (!is_pyopencl(boxes)) {
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
      return {.buffer = to_handle<cl_mem>(boxes), .count = bytes / sizeof(Aabb)};
    }
    refuse_other_queue(boxes, name);
    const DeviceLayout layout = layout_of(boxes);
    const std::size_t stride = layout.stride_of_boxes(name);
    if (layout.shape[0] == 0) return {.buffer = buffer_without_boxes()};
    return {.buffer = buffer_of(boxes, name),
            .count = layout.shape[0],
            .offset = nb::cast<std::size_t>(boxes.attr("offset")),
            .stride = stride};
  }

  /// For a set without boxes, whose array has none.
  cl_mem buffer_without_boxes() {
    if (!empty_.is_valid()) {
      const nb::object cl = nb::module_::import_("pyopencl");
      empty_ =
          cl.attr("Buffer")(queue_.attr("context"), cl.attr("mem_flags").attr("READ_ONLY"), sizeof(Aabb));
    }
    return to_handle<cl_mem>(empty_);
  }

  cl_mem to_filters(nb::handle filters, std::size_t count) const {
    if (filters.is_none()) return nullptr;
    if (is_buffer(filters)) return to_handle<cl_mem>(filters);
    if (!is_array(filters)) {
      throw nb::type_error(("filters must be a pyopencl array or buffer, not " + kind_of(filters)).c_str());
    }
    refuse_other_queue(filters, "filters");
    const DeviceLayout layout = layout_of(filters);
    const std::vector<std::size_t> shape = {count, 4};
    const std::vector<std::ptrdiff_t> strides = {16, 4};
    const bool is_whole = nb::cast<std::size_t>(filters.attr("offset")) == 0;
    if (layout.dtype != "uint32" || layout.shape != shape || (count > 1 && layout.strides != strides) ||
        !is_whole) {
      throw nb::value_error(
          ("filters must be uint32 of shape (" + std::to_string(count) +
           ", 4), contiguous and at the start of a buffer: group, mask, body, world of each "
           "box; not " +
           layout.dtype + " of shape " + layout.text())
              .c_str());
    }
    return buffer_of(filters, "filters");
  }

  nb::object queue_;
  nb::object pool_;   // of the arrays that are returned
  nb::object empty_;  // a buffer
};

}  // namespace

bool is_pyopencl(nb::handle object) {
  return is_array(object) || is_buffer(object);
}

DeviceArraysPointer pyopencl_arrays(nb::handle queue) {
  return DeviceArraysPointer(is_queue(queue) ? new PyopenclArrays(queue) : nullptr);
}

}  // namespace broadcl::python
