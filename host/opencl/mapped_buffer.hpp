#pragma once

#include <cstddef>
#include <memory>

#include "opencl/api.hpp"
#include "opencl/context.hpp"

namespace broadcl::opencl {

/// A buffer that both host and device access: mapped while it belongs to the host, unmapped while it belongs
/// to the device.
class MappedBuffer {
 public:
  MappedBuffer() = default;
  /// Takes a buffer, which belongs to the device at first.
  MappedBuffer(const Context& context, cl::Buffer buffer, std::size_t bytes);
  /// Pinned host memory that always belongs to the host: copies to and from the device run at the full speed
  /// of the bus. Not initialised; waits until it is mapped.
  /// @param bytes At least 1.
  /// @throws cl::Error
  [[nodiscard]] static MappedBuffer pinned(const Context& context, std::size_t bytes);
  /// The same in direct memory: kernels can access it, too. Context::has_direct_memory() must hold.
  /// @param blocking If false, the host may access it after the next command in the queue has ended.
  [[nodiscard]] static MappedBuffer direct(const Context& context, std::size_t bytes,
                                           cl_bool blocking = CL_TRUE);
  ~MappedBuffer();
  MappedBuffer(MappedBuffer&& other) noexcept;             // NOLINT(bugprone-exception-escape)
  MappedBuffer& operator=(MappedBuffer&& other) noexcept;  // NOLINT(bugprone-exception-escape)

  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  [[nodiscard]] const cl::Buffer& buffer() const noexcept { return buffer_; }
  [[nodiscard]] bool is_direct() const noexcept { return is_direct_; }
  /// Null while it belongs to the device.
  [[nodiscard]] std::byte* host() const noexcept { return host_; }

  /// Enqueues the command that maps it for the host, which may access it after the event. No-op if it belongs
  /// to the host already.
  /// @throws cl::Error
  void map(cl_bool blocking = CL_FALSE, cl::Event* event = nullptr);
  /// Enqueues the command that releases it to the device. No-op if it belongs to the device already.
  /// @throws cl::Error
  void unmap();

  [[nodiscard]] const cl::CommandQueue& queue() const noexcept { return queue_; }

 private:
  cl::CommandQueue queue_;
  cl::Buffer buffer_;
  std::size_t bytes_ = 0;
  bool is_direct_ = false;
  std::byte* host_ = nullptr;
};

/// Shares a buffer with users who may keep it (kept.hpp), also longer than the context, which waits for its
/// queue: once that is gone, whoever has the last copy waits until the memory is released. It is not deleted
/// if the process was forked.
[[nodiscard]] std::shared_ptr<MappedBuffer> share(const Context& context, MappedBuffer buffer);

}  // namespace broadcl::opencl
