#pragma once

#include <cstddef>
#include <span>

#include <broadcl/aabb.hpp>

#include "algorithms/algorithm.hpp"
#include "algorithms/pair_finder.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {

/// The objects of an algorithm that runs on a device: the host writes boxes in place, the device has them as
/// of the last update and gets what changed.
class DeviceObjects {
 public:
  /// @param context, profiler Must outlive this object.
  DeviceObjects(const opencl::Context& context, opencl::Profiler& profiler);

  /// Makes room for at least this many slots and keeps the boxes that are there.
  /// @throws Error
  void reserve(std::size_t slots);

  /// Where the host writes boxes, while they are the host's.
  /// @throws Error where the device did not give them back when it failed, and does not now.
  [[nodiscard]] std::span<Aabb> boxes();

  /// Gives them to the device, which gets what changed: all boxes, or those that did.
  /// @throws cl::Error
  Search upload(const Changes& changes);
  /// Gives them back to the host, once the queue has come so far.
  void reclaim();
  /// The same, at once, after the device has failed. Where it fails in this too, boxes() tries again.
  void give_up() noexcept;
  /// Gives them to the device again, for another run of the same search.
  void lend();

 private:
  /// Memory that should be the host's but is not, since a give_up() failed.
  void reclaim_what_failed();
  void upload_filters(const Changes& changes);
  cl_uint upload_changes(const Changes& changes);
  void apply_changes(cl_uint count);

  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  cl::Kernel apply_;
  opencl::SharedBuffer boxes_;
  bool is_device_behind_ = false;  // boxes_ was made anew, and the device has none of them
  opencl::SharedBuffer filters_;
  std::size_t filter_count_ = 0;  // that the device has
  opencl::SharedBuffer changes_;  // as kernels/changes.cl reads them
  cl::Buffer changed_;            // their slots
  cl::Buffer stamps_;             // a word a slot
  cl_uint stamp_ = 0;             // of the last update
};

}  // namespace broadcl
