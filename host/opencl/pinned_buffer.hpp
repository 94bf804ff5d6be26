#pragma once

#include <cstddef>

#include "opencl/api.hpp"
#include "opencl/context.hpp"

namespace broadcl::opencl {

/// Memory of the host that the device reads and writes at the full speed of the bus. It is the host's to use,
/// but while a command that was given its address runs.
class PinnedBuffer {
 public:
  PinnedBuffer() = default;
  /// Not initialised. @param bytes At least 1.
  /// @throws cl::Error
  PinnedBuffer(const Context& context, std::size_t bytes);
  ~PinnedBuffer();
  PinnedBuffer(PinnedBuffer&& other) noexcept;             // NOLINT(bugprone-exception-escape)
  PinnedBuffer& operator=(PinnedBuffer&& other) noexcept;  // NOLINT(bugprone-exception-escape)
  PinnedBuffer(const PinnedBuffer&) = delete;
  PinnedBuffer& operator=(const PinnedBuffer&) = delete;

  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  [[nodiscard]] std::byte* host() const noexcept { return host_; }

 private:
  cl::CommandQueue queue_;
  cl::Buffer buffer_;
  std::size_t bytes_ = 0;
  std::byte* host_ = nullptr;  // mapped from beginning to end
};

}  // namespace broadcl::opencl
