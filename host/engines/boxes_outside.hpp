#pragma once

#include <cstddef>
#include <cstdint>

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>

#include "engines/source.hpp"
#include "opencl/api.hpp"
#include "opencl/context.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/launch.hpp"
#include "opencl/scan.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {

/// Finds the caller's boxes that are not within another box, and copies them to the host:
/// kernels/outside.cl.
class BROADCL_API BoxesOutside {
 public:
  /// @param context Must outlive this object.
  /// @throws Error
  explicit BoxesOutside(const opencl::Context& context);

  /// Enqueues the commands, and makes the device start.
  /// @param filters One per box; or null.
  /// @param inner Packed.
  /// @throws Error
  void begin(const Source::Boxes& boxes, const cl::Buffer& filters, const Aabb& inner);
  /// Waits for the device.
  /// @returns How many boxes it found.
  /// @throws Error
  std::size_t finish();

  struct Found {
    std::uint32_t index;
    Aabb box;
    Filter filter;
  };
  /// One of those that it found, in the order of their indices; no improper ones. Valid until begin().
  [[nodiscard]] Found operator[](std::size_t k) const noexcept;

 private:
  [[nodiscard]] std::size_t words_per_box() const noexcept;
  void enqueue_copy();

  const opencl::Context& context_;
  opencl::SizedKernel mark_, copy_;
  opencl::Scan scan_;
  opencl::GrowingBuffer marks_;
  opencl::SharedBuffer found_;
  std::size_t capacity_ = 0;  // of found_, in words
  std::size_t expected_ = 0;  // boxes
  // Of the commands that were enqueued.
  std::size_t boxes_ = 0;
  cl::Buffer source_, filters_;  // The caller's, since kernels do not own their arguments.
  std::size_t most_ = 0;         // boxes
  cl::Event ready_;
};

}  // namespace broadcl
