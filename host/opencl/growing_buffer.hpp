#pragma once

#include <cstddef>
#include <string_view>

#include "opencl/api.hpp"
#include "opencl/context.hpp"

namespace broadcl::opencl {

/// How large a buffer is to be that must hold so many bytes: a quarter more, as far as the device allocates
/// as much at once, so that a buffer that grows step by step is seldom replaced.
/// @param what It holds, for the error: "overlapping pairs".
/// @throws Error if the device does not even allocate what is needed.
[[nodiscard]] std::size_t grown(const Context& context, std::size_t bytes, std::string_view what);

/// A buffer on the device that is replaced by a larger one if it is too small.
class GrowingBuffer {
 public:
  /// Has room for at least so many bytes afterwards. If it must grow, what it held is lost, and is released
  /// first: memory need not hold both.
  /// @throws Error, cl::Error; it is then empty.
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
