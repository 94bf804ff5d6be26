#pragma once

#include <cstddef>
#include <memory>

#include "base/kept.hpp"
#include "opencl/api.hpp"
#include "opencl/context.hpp"
#include "opencl/mapped_buffer.hpp"

namespace broadcl::opencl {

/// Memory that the device writes and the host reads. If they share memory it is one buffer, mapped while it
/// belongs to the host, and nothing is ever copied. Otherwise it is a buffer on the device and its twin in
/// pinned host memory, or, on request, host memory that kernels write.
class SharedBuffer {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
 public:
  SharedBuffer() = default;
  ~SharedBuffer() = default;
  SharedBuffer(SharedBuffer&&) noexcept = default;
  SharedBuffer& operator=(SharedBuffer&&) noexcept = default;  // NOLINT(bugprone-exception-escape): as above
  /// Belongs to the device, not initialised.
  /// @param bytes At least 1.
  /// @throws cl::Error
  /// @param direct Whether kernels are to write host memory, if the device can.
  SharedBuffer(const Context& context, std::size_t bytes, bool direct = false);

  [[nodiscard]] std::size_t bytes() const noexcept { return host_->bytes(); }
  [[nodiscard]] std::byte* host() const noexcept { return host_->host(); }
  [[nodiscard]] const cl::Buffer& device() const noexcept {
    return device_() != nullptr ? device_ : host_->buffer();
  }

  /// Of the memory of host(). Do not call release() or download() as long as there are copies.
  [[nodiscard]] std::shared_ptr<const void> owner() const noexcept { return host_; }
  /// Whether there are.
  [[nodiscard]] bool is_kept() const noexcept { return broadcl::is_kept(host_); }

  /// Enqueues the command that releases it to the device.
  /// @throws cl::Error
  void release();
  /// Whether kernels write host memory. The host may access it when the last of them has ended.
  [[nodiscard]] bool is_direct() const noexcept { return host_->is_direct(); }
  /// Otherwise: enqueues the transfer of the first `bytes` bytes, as the device wrote them, to the host,
  /// which may access them after the event.
  /// @throws cl::Error
  void download(std::size_t bytes, cl::Event* event);

 private:
  cl::CommandQueue queue_;
  cl::Buffer device_;  // null if host and device share memory
  std::shared_ptr<MappedBuffer> host_ = std::make_shared<MappedBuffer>();
};

}  // namespace broadcl::opencl
