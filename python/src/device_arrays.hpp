#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/opencl.hpp>

#include "opencl/process.hpp"

namespace broadcl::python {

/// How a DeviceBroadPhase reads arrays of one kind, and in what it returns results: arrays of pyopencl, or
/// tensors.
class DeviceArrays {
 public:
  DeviceArrays() = default;
  DeviceArrays(const DeviceArrays&) = delete;
  DeviceArrays& operator=(const DeviceArrays&) = delete;
  virtual ~DeviceArrays() = default;

  /// In which all work is done.
  [[nodiscard]] virtual cl_command_queue queue() const = 0;
  /// The same for Python; None if it is this object's own.
  [[nodiscard]] virtual nanobind::object callers_queue() const = 0;

  /// Where the boxes and filters of an update are. What other commands still write is complete on return.
  /// @param second None for one set.
  /// @param filters None for none.
  /// @throws TypeError, ValueError, Error
  [[nodiscard]] virtual DeviceBroadPhase::Boxes read(nanobind::handle first, nanobind::handle second,
                                                     nanobind::handle filters) = 0;
  /// An array of a copy of these pairs, which is enqueued.
  [[nodiscard]] virtual nanobind::object copy(const DeviceBroadPhase::PairBuffer& pairs) = 0;
  /// The same for pairs that will not change any more.
  [[nodiscard]] virtual nanobind::object show(const DeviceBroadPhase::PairBuffer& pairs) = 0;
  /// Waits until others may read the copies.
  virtual void complete() = 0;
  /// Ends an update that failed in place of complete().
  virtual void abandon() noexcept {}

  /// An array (n, 6) that read() takes without a copy.
  /// @throws TypeError if arrays of this kind are never copied.
  [[nodiscard]] virtual nanobind::object make_boxes(std::size_t n) = 0;
  /// Gives back memory that no array uses.
  virtual void shrink() = 0;
};

using DeviceArraysPointer = std::unique_ptr<DeviceArrays, opencl::DeleteUnlessForked>;

/// Whether this is an array or a buffer of pyopencl. (Nothing here imports pyopencl before a caller did.)
[[nodiscard]] bool is_pyopencl(nanobind::handle object);
/// Whether this is a tensor in memory of a device.
[[nodiscard]] bool is_device_tensor(nanobind::handle object);
[[nodiscard]] inline bool is_on_device(nanobind::handle object) {
  return is_pyopencl(object) || is_device_tensor(object);
}

/// For a queue of pyopencl.
[[nodiscard]] DeviceArraysPointer pyopencl_arrays(nanobind::handle queue);
/// For a CUDA device.
/// @param device What stands for one in Python, or a tensor there.
/// @returns Null for anything else.
[[nodiscard]] DeviceArraysPointer tensors(nanobind::handle device, bool profile);

/// @param device Whatever stands for a device or a queue.
/// @throws TypeError, Error
[[nodiscard]] DeviceArraysPointer device_arrays(nanobind::handle device, bool profile);
/// Those of the kind of these boxes, on their device.
/// @param device None for that of the boxes.
/// @throws TypeError, ValueError, Error
[[nodiscard]] DeviceArraysPointer device_arrays_of(nanobind::handle boxes, nanobind::handle device);

/// The name of the type of an object, for messages.
[[nodiscard]] std::string kind_of(nanobind::handle object);

/// What an array on a device says of itself.
struct DeviceLayout {
  std::vector<std::size_t> shape;
  std::vector<std::ptrdiff_t> strides;  ///< In bytes.
  std::string dtype;

  /// From each box to the next, in bytes.
  /// @param name What messages call the boxes.
  /// @throws TypeError, ValueError if these are no boxes that a device can read.
  [[nodiscard]] std::size_t stride_of_boxes(const std::string& name) const;
  [[nodiscard]] std::string text() const;
};

}  // namespace broadcl::python
