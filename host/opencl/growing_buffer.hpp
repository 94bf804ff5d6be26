#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "opencl/api.hpp"
#include "opencl/context.hpp"

namespace broadcl::opencl {

/// @throws Error if the device does not allocate this many bytes at once. Parameters are those of grown().
void refuse_too_large(const Context& context, std::size_t bytes, std::string_view what, std::uint64_t most);

/// The size of a new buffer that must hold this many bytes: a quarter more, but at most what the device
/// allocates at once, so that a buffer that grows step by step is seldom replaced.
/// @param what What it holds, for the error message: "overlapping pairs".
/// @param most What kernels may use: Device::max_allocation, or Context::large_buffers().
/// @throws Error if the device cannot allocate as much as is needed.
[[nodiscard]] std::size_t grown(const Context& context, std::size_t bytes, std::string_view what,
                                std::uint64_t most);
[[nodiscard]] inline std::size_t grown(const Context& context, std::size_t bytes, std::string_view what) {
  return grown(context, bytes, what, context.device().max_allocation);
}

/// A buffer on the device that is replaced by a larger one if it is too small.
class GrowingBuffer {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
 public:
  /// Ensures a capacity of at least this many bytes. If the buffer must grow, its content is lost, and its
  /// memory is released first, so that there need not be memory for both.
  /// @throws Error if the device allocates less at once; it is then as before. cl::Error; it is then empty.
  void reserve(const Context& context, std::size_t bytes, std::string_view what);
  void clear() { *this = {}; }

  /// Null before the first reserve().
  [[nodiscard]] const cl::Buffer& get() const noexcept { return buffer_; }
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }

 private:
  cl::Buffer buffer_;
  std::size_t bytes_ = 0;
};

}  // namespace broadcl::opencl
