#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <string>

#include <broadcl/opencl.hpp>

namespace broadcl::python {

/// Whether this is an array or a buffer of pyopencl. (Nothing here imports pyopencl before a caller did.)
[[nodiscard]] bool is_on_device(nanobind::handle object);

/// The queue in which boxes are searched: the one that is given, otherwise that of the array.
/// @param queue Of pyopencl, or None.
/// @throws TypeError, ValueError if there is none, or if the array has another.
[[nodiscard]] nanobind::object queue_of(nanobind::handle boxes, nanobind::handle queue);

/// @throws TypeError if that is no queue of pyopencl.
[[nodiscard]] cl_command_queue to_queue(nanobind::handle queue);

/// Where the boxes of an array or a buffer of pyopencl are. Nothing is read.
struct DeviceBoxes {
  /// @param name What messages call the boxes.
  /// @throws TypeError, ValueError
  DeviceBoxes(nanobind::handle boxes, nanobind::handle queue, const std::string& name);

  cl_mem buffer = nullptr;
  nanobind::object stand_in;  ///< Owns that buffer if the array, which has no boxes, has none.
  std::size_t count = 0;
  std::size_t offset = 0;
  std::size_t stride = 0;
};

/// Filters in an array (n, 4) uint32, or in a buffer.
/// @throws TypeError, ValueError
[[nodiscard]] cl_mem to_filters(nanobind::handle filters, nanobind::handle queue, std::size_t count);

/// An array (m, 2) uint32 of pyopencl that shows these pairs and keeps their buffer alive.
[[nodiscard]] nanobind::object show_on_device(const DeviceBroadPhase::PairBuffer& pairs,
                                              nanobind::handle queue);

/// A pool of pyopencl for memory on the device of a queue, with two sizes between each power of two and the
/// next. To allocate a buffer may take longer than an update.
[[nodiscard]] nanobind::object make_memory_pool(nanobind::handle queue);
/// An array of a copy of these pairs, which is enqueued, in memory of a pool.
[[nodiscard]] nanobind::object copy_on_device(const DeviceBroadPhase::PairBuffer& pairs,
                                              nanobind::handle queue, nanobind::handle pool);

}  // namespace broadcl::python
