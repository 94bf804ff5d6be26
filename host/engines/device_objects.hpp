#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include <broadcl/aabb.hpp>
#include <broadcl/pair.hpp>

#include "engines/algorithm.hpp"
#include "engines/frame.hpp"
#include "engines/search.hpp"
#include "opencl/context.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/mapped_buffer.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// The objects of a BroadPhase on a device. The host writes boxes to pinned memory; in each frame those that
/// changed are uploaded, and the device keeps the boxes of the last frame as well.
class DeviceObjects {
 public:
  /// @param context, profiler, frames Must outlive this object.
  /// @throws cl::Error, Error
  DeviceObjects(const opencl::Context& context, opencl::Profiler& profiler, Frames& frames);

  /// As Algorithm::reserve().
  /// @throws cl::Error, Error; nothing has changed then.
  void reserve(std::size_t slots, bool filters);

  /// Another object that continues after the last frame of this one, with memory for this many slots, and for
  /// filters only if that frame has some.
  /// @param frames Of the new object.
  /// @throws cl::Error, Error
  [[nodiscard]] std::unique_ptr<DeviceObjects> successor(std::size_t slots, Frames& frames) const;

  /// As Algorithm::reserve_exclusions().
  /// @throws cl::Error, Error; nothing has changed then.
  void reserve_exclusions(std::size_t count);

  /// The boxes, for the host to write, except between upload() and the end of the frame.
  [[nodiscard]] std::span<Aabb> boxes() const noexcept;
  /// As Algorithm::spare_boxes() and swap_boxes().
  /// @throws cl::Error, Error
  [[nodiscard]] std::span<Aabb> spare_boxes();
  void swap_boxes() noexcept { boxes_.swap(spare_); }
  /// As Algorithm::boxes_owner().
  [[nodiscard]] std::shared_ptr<const void> boxes_owner() const noexcept { return boxes_; }

  /// Enqueues the commands that update the device's objects.
  /// @throws cl::Error, Error; the objects of the last frame are then unchanged.
  Search upload(const Input& input);
  /// The rest, if boxes are still being written: enqueues the upload of each piece that is there.
  /// @throws As upload() and BoxReplacement::next().
  void upload_arriving(const Input& input);
  /// The frame succeeded, and has become the last one.
  void commit() noexcept;  // NOLINT(bugprone-exception-escape)

 private:
  [[nodiscard]] std::size_t capacity_for(std::size_t slots) const;
  [[nodiscard]] std::size_t bytes_for(std::size_t slots) const noexcept;
  void reserve_boxes(std::size_t slots);
  void prepare_reaches(const Input& input);
  void grow_boxes(const Input& input);
  bool upload_filters(const Input& input);
  void upload_exclusions(const Input& input);
  void upload_boxes(const Input& input, bool with_filters);
  void upload_changes(const Input& input, bool with_filters);

  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  Frame &now_, &last_;
  opencl::SizedKernel apply_, copy_, grow_;
  std::size_t capacity_ = 0;  // slots
  // Pinned memory, from which the device is updated. Changes are in direct memory if there is any.
  std::shared_ptr<opencl::MappedBuffer> boxes_;
  std::shared_ptr<opencl::MappedBuffer> spare_;  // null until it is needed
  opencl::MappedBuffer staged_changes_;          // as kernels/changes.cl reads them
  opencl::MappedBuffer staged_filters_;          // all
  opencl::MappedBuffer staged_exclusions_;
  opencl::MappedBuffer staged_reaches_;  // all, of the last frame; NaN if it is not known
  opencl::GrowingBuffer changes_;        // those that are staged, on the device, unless kernels read these
  opencl::GrowingBuffer reaches_;        // those that are staged, on the device
  cl::Buffer stamps_;                    // one word per slot
  cl_uint stamp_ = 0;                    // of the last frame
};

}  // namespace broadcl
