#pragma once

#include <cstddef>

#include "opencl/api.hpp"
#include "opencl/context.hpp"

namespace broadcl::opencl {

/// Memory that both host and device reach. Where they share memory it is one buffer, mapped while it is the
/// host's, and nothing is ever copied; else a buffer on the device and its twin in pinned host memory.
///
/// It belongs to the host at first. Every call enqueues and returns at once; host memory may be touched again
/// when the queue has finished the command that gave it back.
class SharedBuffer {
 public:
  SharedBuffer() = default;
  /// Not initialised. @param bytes At least 1.
  SharedBuffer(const Context& context, std::size_t bytes);
  ~SharedBuffer();
  SharedBuffer(SharedBuffer&& other) noexcept;             // NOLINT(bugprone-exception-escape)
  SharedBuffer& operator=(SharedBuffer&& other) noexcept;  // NOLINT(bugprone-exception-escape)
  SharedBuffer(const SharedBuffer&) = delete;
  SharedBuffer& operator=(const SharedBuffer&) = delete;

  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  [[nodiscard]] std::byte* host() const noexcept { return host_; }
  [[nodiscard]] const cl::Buffer& device() const noexcept { return device_; }

  /// Gives it to the device, with the first `bytes` bytes as the host wrote them.
  void upload(std::size_t bytes, cl::Event* event = nullptr);
  /// Gives it to the device, which will write it.
  void lend(cl::Event* event = nullptr);
  /// Gives it back to the host, with the first `bytes` bytes as the device wrote them.
  void download(std::size_t bytes, cl::Event* event = nullptr);
  /// Gives it back to the host, with the content that the host knows, unless the device wrote it.
  void reclaim(cl::Event* event = nullptr);

 private:
  void map(cl::Event* event);
  void unmap(cl::Event* event);

  cl::CommandQueue queue_;
  cl::Buffer device_;
  cl::Buffer pinned_;  // null where host and device share memory
  std::size_t bytes_ = 0;
  std::byte* host_ = nullptr;  // null while the device has shared memory
};

}  // namespace broadcl::opencl
