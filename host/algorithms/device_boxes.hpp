#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <span>
#include <utility>

#include <broadcl/aabb.hpp>

#include "opencl/context.hpp"
#include "opencl/error.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {

/// The boxes of an algorithm that runs on a device: the host writes them in place, the device reads them as
/// aabb.h says.
class DeviceBoxes {
 public:
  /// Kernels may read, though not use, as many boxes past the last one.
  static constexpr std::size_t padding = 16;

  /// Makes room for at least this many boxes and keeps those that are there.
  /// @throws Error
  void reserve(const opencl::Context& context, std::size_t boxes) {
    if (boxes <= host().size()) return;
    opencl::translate_errors(context.device().label(), [&] {
      const std::size_t capacity = std::max({boxes, host().size() * 3 / 2, std::size_t{256}});
      opencl::SharedBuffer larger(context, (capacity + padding) * sizeof(Aabb));
      if (buffer_.bytes() > 0) std::memcpy(larger.host(), buffer_.host(), buffer_.bytes());
      buffer_ = std::move(larger);
    });
  }

  /// Where the host writes them, while they are the host's.
  [[nodiscard]] std::span<Aabb> host() const noexcept {
    const std::size_t boxes = buffer_.bytes() / sizeof(Aabb);
    return {reinterpret_cast<Aabb*>(buffer_.host()), boxes == 0 ? 0 : boxes - padding};
  }

  [[nodiscard]] const cl::Buffer& device() const noexcept { return buffer_.device(); }

  /// Gives the first n boxes to the device.
  void upload(std::size_t n, cl::Event* event) { buffer_.upload(n * sizeof(Aabb), event); }
  /// Gives them back to the host.
  void reclaim() { buffer_.reclaim(); }

 private:
  opencl::SharedBuffer buffer_;
};

}  // namespace broadcl
