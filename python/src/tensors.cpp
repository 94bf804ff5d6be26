#include <nanobind/nanobind.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <initializer_list>
#include <list>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>

#include "device_arrays.hpp"
#include "gil.hpp"
#include "opencl/devices.hpp"
#include "opencl/error.hpp"
#include "opencl/launch.hpp"
#include "opencl/opened_device.hpp"
#include "shared_memory.hpp"
#include "tensor.hpp"

namespace nb = nanobind;

namespace broadcl::python {
namespace {

/// The device of OpenCL that is the same.
std::shared_ptr<opencl::OpenedDevice> open(const TensorDevice& device) {
  const Device found = device.find();
  auto opened = opencl::translate_errors(found.label(), [&] { return opencl::opened_device(found); });
  const auto extensions = opencl::translate_errors(
      opened->label, [&] { return opened->cl_device.getInfo<CL_DEVICE_EXTENSIONS>(); });
  if (extensions.find("cl_khr_external_memory_opaque_fd") == std::string::npos) {
    throw Error(
        found.label() + ", driver " + found.driver_version +
        ", cannot share memory with CUDA (it has no cl_khr_external_memory_opaque_fd); install a newer "
        "driver, or copy boxes to the host and use a BroadPhase");
  }
  return opened;
}

/// A function of cl_khr_external_memory, which hands memory over.
using HandOver = cl_int (*)(cl_command_queue, cl_uint, const cl_mem*, cl_uint, const cl_event*, cl_event*);

HandOver find_function(const opencl::OpenedDevice& opened, const char* name) {
  const auto function = reinterpret_cast<HandOver>(opencl::translate_errors(opened.label, [&] {
    return clGetExtensionFunctionAddressForPlatform(opencl::platform_of(opened.cl_device)(), name);
  }));
  if (function == nullptr) throw Error(opened.label + " has no " + name + "; install a newer driver");
  return function;
}

/// Tensors of CUDA, in a queue of this object's own.
class Tensors final : public DeviceArrays {
 public:
  Tensors(const std::shared_ptr<TensorDevice>& device, bool profile)
      : opened_(open(*device)),
        memory_(SharedMemory::create(device, opened_->context)),
        queue_(with_opencl([&] {
          return cl::CommandQueue(opened_->context, opened_->cl_device,
                                  profile ? CL_QUEUE_PROFILING_ENABLE : 0);
        })) {}
  Tensors(const Tensors&) = delete;
  Tensors& operator=(const Tensors&) = delete;
  ~Tensors() override { abandon(); }

  cl_command_queue queue() const override { return queue_(); }
  nb::object callers_queue() const override { return nb::none(); }

  DeviceBroadPhase::Boxes read(nb::handle first, nb::handle second, nb::handle filters) override {
    opencl::use_in_this_process();
    Reader reader(*this);
    const DeviceBroadPhase::SecondSet one =
        reader.boxes(first, second.is_none() ? "boxes" : "the first set", 0);
    DeviceBroadPhase::Boxes boxes{
        .buffer = one.buffer, .count = one.count, .offset = one.offset, .stride = one.stride};
    if (!second.is_none()) boxes.second = reader.boxes(second, "the second set", 1);
    if (!filters.is_none()) boxes.filters = reader.filters(filters, boxes.count + boxes.second.count);
    reader.wait();
    acquire({boxes.buffer, boxes.second.buffer, boxes.filters});
    return boxes;
  }

  nb::object copy(const DeviceBroadPhase::PairBuffer& pairs) override {
    SharedMemory::Pointer piece;
    if (pairs.count > 0) {
      with_opencl([&] {
        const std::size_t bytes = pairs.count * sizeof(Pair);
        piece = memory_->take(bytes);
        acquire({piece->buffer});
        queue_.enqueueCopyBuffer(cl::Buffer(pairs.buffer, true), cl::Buffer(piece->buffer, true), 0,
                                 piece->offset, bytes);
      });
    }
    return make_array(std::move(piece), pairs.count, 2, "int32");
  }

  nb::object show(const DeviceBroadPhase::PairBuffer& pairs) override {
    nb::object array = copy(pairs);
    complete();
    return array;
  }

  void complete() override {
    const GilReleased released;
    with_opencl([&] {
      if (const cl_int error = release(); error != CL_SUCCESS) {
        throw cl::Error(error, "clEnqueueReleaseExternalMemObjectsKHR");
      }
      queue_.finish();
    });
  }

  void abandon() noexcept override {
    (void)release();
    opencl::wait_if_possible(queue_);
  }

  nb::object make_boxes(std::size_t n) override {
    return make_array(n == 0 ? nullptr : take_block(n * sizeof(Aabb)), n, 6, "float32");
  }

  void shrink() override {
    inputs_ = {};
    with_opencl([&] { memory_->shrink(); });
  }

 private:
  /// Reads the tensors of one update.
  class Reader {
   public:
    explicit Reader(Tensors& tensors) : tensors_(tensors) {}

    DeviceBroadPhase::SecondSet boxes(nb::handle object, const std::string& name, std::size_t input) {
      const Tensor& tensor = add(object, name);
      const std::size_t stride = tensor.layout.stride_of_boxes(name);
      const std::size_t count = tensor.layout.shape[0];
      const SharedMemory::Piece there = tensors_.memory_->find(count > 0 ? tensor.address : 0);
      if (there.buffer != nullptr && tensor.address % sizeof(float) == 0) {
        return {.buffer = there.buffer, .count = count, .offset = there.offset, .stride = stride};
      }
      if (count > 1 && stride <= 2 * sizeof(Aabb)) {  // faster than box by box
        const std::size_t bytes = (count - 1) * stride + sizeof(Aabb);
        return {.buffer = copy(tensor, 1, bytes, bytes, input), .count = count, .stride = stride};
      }
      return {.buffer = copy(tensor, count, sizeof(Aabb), stride, input), .count = count};
    }

    cl_mem filters(nb::handle object, std::size_t count) {
      const Tensor& tensor = add(object, "filters");
      const auto& [shape, strides, dtype] = tensor.layout;
      const bool is_integer = dtype == "int32" || dtype == "uint32";
      const bool is_table = shape == std::vector<std::size_t>{count, 4} && (count == 0 || strides[1] == 4) &&
                            (count < 2 || strides[0] >= std::ptrdiff_t{sizeof(Filter)});
      if (!is_integer || !is_table) {
        throw nb::value_error(
            ("filters must be int32 or uint32 of shape (" + std::to_string(count) +
             ", 4), with the numbers of a row side by side: group, mask, body, world of each "
             "box; not " +
             dtype + " of shape " + tensor.layout.text())
                .c_str());
      }
      return copy(tensor, count, sizeof(Filter), static_cast<std::size_t>(strides[0]), 2);
    }

    /// Until all is there.
    void wait() {
      SharedMemory& memory = *tensors_.memory_;
      for (const Tensor& tensor : tensors_read_) {
        if (&tensor != &tensors_read_.back()) memory.wait(tensor.stream, {});
      }
      memory.wait(tensors_read_.back().stream, copies_);
    }

   private:
    const Tensor& add(nb::handle object, const std::string& name) {
      return tensors_read_.emplace_back(object, tensors_.memory_->device(), name);
    }

    /// @param input Which of the buffers to copy to.
    cl_mem copy(const Tensor& tensor, std::size_t rows, std::size_t width, std::size_t stride,
                std::size_t input) {
      SharedMemory::Pointer& piece = tensors_.inputs_.at(input);
      const std::size_t bytes = std::max<std::size_t>(rows, 1) * width;
      if (piece == nullptr || piece->size < bytes) {
        piece.reset();
        piece = tensors_.take_block(bytes);
      }
      if (rows > 0) {
        copies_.push_back({.to = piece->address,
                           .from = tensor.address,
                           .rows = rows,
                           .width = width,
                           .stride = rows > 1 ? stride : width});
      }
      return piece->buffer;
    }

    Tensors& tensors_;
    std::list<Tensor> tensors_read_;
    std::vector<TensorDevice::Copy> copies_;
  };

  /// Takes memory over from CUDA.
  void acquire(std::initializer_list<cl_mem> buffers) {
    with_opencl([&] {
      for (cl_mem const buffer : buffers) {
        if (buffer == nullptr || std::ranges::find(acquired_, buffer) != acquired_.end()) continue;
        acquired_.push_back(buffer);
        const cl_int error = acquire_(queue_(), 1, &buffer, 0, nullptr, nullptr);
        if (error == CL_SUCCESS) continue;
        acquired_.pop_back();
        throw cl::Error(error, "clEnqueueAcquireExternalMemObjectsKHR");
      }
    });
  }

  /// Gives all of it back.
  cl_int release() noexcept {
    const auto count = static_cast<cl_uint>(acquired_.size());
    const cl_int error =
        count == 0 ? CL_SUCCESS : release_(queue_(), count, acquired_.data(), 0, nullptr, nullptr);
    acquired_.clear();
    return error;
  }

  /// Calls a function that uses OpenCL.
  template <class Function>
  std::invoke_result_t<Function> with_opencl(Function&& function) const {
    return opencl::translate_errors(opened_->label, std::forward<Function>(function));
  }

  /// Memory that begins its buffer: boxes there can be searched where they are.
  SharedMemory::Pointer take_block(std::size_t bytes) {
    return with_opencl([&] { return memory_->take(std::max(bytes, SharedMemory::whole_block)); });
  }

  nb::object make_array(SharedMemory::Pointer piece, std::size_t rows, std::size_t columns,
                        const char* dtype) {
    return nb::cast(DeviceArray(std::move(piece), memory_, memory_->device().id(), {rows, columns}, dtype));
  }

  std::shared_ptr<opencl::OpenedDevice> opened_;
  HandOver acquire_ = find_function(*opened_, "clEnqueueAcquireExternalMemObjectsKHR");
  HandOver release_ = find_function(*opened_, "clEnqueueReleaseExternalMemObjectsKHR");
  std::vector<cl_mem> acquired_;
  std::shared_ptr<SharedMemory> memory_;
  cl::CommandQueue queue_;
  std::array<SharedMemory::Pointer, 3> inputs_;  // copies of boxes, of a second set, and of filters
};

}  // namespace

DeviceArraysPointer tensors(nb::handle device, bool profile) {
  const auto id = to_device_id(device);
  if (!id) return nullptr;
  if (id->kind != TensorDeviceId::cuda && id->kind != TensorDeviceId::cuda_managed) {
    throw nb::type_error(("device must be a CUDA device, not one of the kind " + std::to_string(id->kind) +
                          " of DLPack; for boxes elsewhere, copy them to the host and use a BroadPhase")
                             .c_str());
  }
  return DeviceArraysPointer(new Tensors(open_cuda_device(id->index), profile));
}

}  // namespace broadcl::python
