#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "device_arrays.hpp"
#include "shared_memory.hpp"
#include "tensor_device.hpp"

namespace broadcl::python {

/// What stands for a device in Python: "cuda:1", a pair of integers of DLPack, torch.device, a tensor.
/// @returns Nothing for anything else.
[[nodiscard]] std::optional<TensorDeviceId> to_device_id(nanobind::handle object);

/// A tensor of the caller: DLPack, or the CUDA array interface.
struct Tensor {
  /// @param name What messages call it.
  /// @throws TypeError, ValueError if it is not in memory of this device, Error; what its library throws.
  Tensor(nanobind::handle object, const TensorDevice& device, const std::string& name);

  DeviceLayout layout;
  TensorDevice::Address address = 0;
  std::optional<TensorDevice::Stream> stream;  ///< Fills it; nothing: any of them.
  nanobind::ndarray<nanobind::ro> array;       ///< Keeps its memory, if that came by DLPack.
};

/// A tensor in shared memory, for results and for boxes: class DeviceArray of Python.
class DeviceArray {
 public:
  /// @param memory Null if it has no elements.
  DeviceArray(SharedMemory::Pointer memory, std::shared_ptr<SharedMemory> of, TensorDeviceId device,
              std::vector<std::size_t> shape, std::string dtype);

  [[nodiscard]] nanobind::object dlpack(nanobind::handle self, nanobind::handle max_version,
                                        nanobind::handle dl_device, nanobind::handle copy) const;
  [[nodiscard]] nanobind::tuple dlpack_device() const;
  [[nodiscard]] nanobind::dict cuda_array_interface() const;
  [[nodiscard]] nanobind::tuple shape() const;
  [[nodiscard]] nanobind::object dtype() const;
  [[nodiscard]] std::size_t size() const noexcept { return shape_.front(); }
  /// A copy in an array of NumPy.
  [[nodiscard]] nanobind::object get() const;
  /// The same memory as numbers of another type of four bytes.
  [[nodiscard]] DeviceArray view(nanobind::handle dtype) const;

 private:
  std::shared_ptr<SharedMemory> of_;
  SharedMemory::Pointer memory_;
  TensorDeviceId device_;
  std::vector<std::size_t> shape_;
  std::string dtype_;  // as NumPy names it
};

}  // namespace broadcl::python
