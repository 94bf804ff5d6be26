#pragma once

#include <cstddef>
#include <span>

#include <broadcl/aabb.hpp>

#include "algorithms/algorithm.hpp"
#include "algorithms/search.hpp"
#include "opencl/context.hpp"
#include "opencl/pinned_buffer.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// The objects of an algorithm that runs on a device: the host writes boxes in place; the device gets what
/// changed of them in each update, and keeps them as they were in the one before.
class DeviceObjects {
 public:
  /// @param context, profiler Must outlive this object.
  DeviceObjects(const opencl::Context& context, opencl::Profiler& profiler);

  /// Makes room for at least this many slots and keeps the boxes that are there.
  /// @throws Error
  void reserve(std::size_t slots);

  /// Where the host writes boxes, but not during an update.
  [[nodiscard]] std::span<Aabb> boxes() const noexcept;

  /// Enqueues an update of the device's boxes: of all, or of those that changed.
  /// @throws cl::Error
  Search upload(const Changes& changes);
  /// The update succeeded: what it searched is the last one's from now on.
  void commit();

 private:
  /// Objects as of one update.
  struct Generation {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl::Buffer boxes;
    cl_uint slots = 0;
    bool all = true;     // came at once, not those alone that are in `changed`
    cl::Buffer changed;  // slots
    std::size_t changed_capacity = 0;
    cl_uint changed_count = 0;
    cl::Buffer filters;
    std::size_t filter_capacity = 0;
    std::size_t filter_count = 0;  // 0 where there were none
  };

  void upload_filters(const Changes& changes);
  void upload_boxes(const Changes& changes);
  void upload_changes(const Changes& changes);

  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  cl::Kernel apply_, copy_;
  opencl::PinnedBuffer boxes_;
  Generation last_;                      // of the last update
  Generation next_;                      // of the one that is begun
  bool are_filters_new_ = false;         // in next_; else those of last_ are still right
  opencl::PinnedBuffer staged_changes_;  // as kernels/changes.cl reads them
  cl::Buffer changes_;
  cl::Buffer stamps_;  // a word a slot
  cl_uint stamp_ = 0;  // of the last update
};

}  // namespace broadcl
