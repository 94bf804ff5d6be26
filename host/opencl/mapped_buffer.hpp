#pragma once

#include <cstddef>

#include "opencl/api.hpp"
#include "opencl/context.hpp"

namespace broadcl::opencl {

/// A buffer that host and device both reach: mapped while it is the host's, unmapped while it is the
/// device's.
class MappedBuffer {
 public:
  MappedBuffer() = default;
  /// Takes a buffer that belongs to the device.
  MappedBuffer(const Context& context, cl::Buffer buffer, std::size_t bytes);
  /// Pinned host memory that stays the host's: copies to and from the device run at the full speed of the
  /// bus. Not initialised; waits until it is mapped.
  /// @param bytes At least 1.
  /// @throws cl::Error
  [[nodiscard]] static MappedBuffer pinned(const Context& context, std::size_t bytes);
  ~MappedBuffer();
  MappedBuffer(MappedBuffer&& other) noexcept;             // NOLINT(bugprone-exception-escape)
  MappedBuffer& operator=(MappedBuffer&& other) noexcept;  // NOLINT(bugprone-exception-escape)
  MappedBuffer(const MappedBuffer&) = delete;
  MappedBuffer& operator=(const MappedBuffer&) = delete;

  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  [[nodiscard]] const cl::Buffer& buffer() const noexcept { return buffer_; }
  /// Null while it is the device's.
  [[nodiscard]] std::byte* host() const noexcept { return host_; }

  /// Enqueues what gives it to the host, which may touch it after the event. No-op if the host has it.
  /// @throws cl::Error
  void map(cl_bool blocking = CL_FALSE, cl::Event* event = nullptr);
  /// Enqueues what gives it to the device. No-op if the device has it.
  /// @throws cl::Error
  void unmap(cl::Event* event = nullptr);

 private:
  cl::CommandQueue queue_;
  cl::Buffer buffer_;
  std::size_t bytes_ = 0;
  std::byte* host_ = nullptr;
};

}  // namespace broadcl::opencl
