#include "opencl/pinned_buffer.hpp"

#include <utility>

namespace broadcl::opencl {

PinnedBuffer::PinnedBuffer(const Context& context, std::size_t bytes)
    : queue_(context.queue()), buffer_(context.pinned(bytes)), bytes_(bytes) {
  host_ = static_cast<std::byte*>(
      queue_.enqueueMapBuffer(buffer_, CL_TRUE, CL_MAP_READ | CL_MAP_WRITE, 0, bytes_));
}

PinnedBuffer::~PinnedBuffer() {
  if (host_ == nullptr) return;
  // A destructor cannot report: the C call, whose code is let go.
  (void)clEnqueueUnmapMemObject(queue_(), buffer_(), host_, 0, nullptr, nullptr);
}

// Moving handles of the bindings does not throw, though they do not say so.
// NOLINTNEXTLINE(bugprone-exception-escape)
PinnedBuffer::PinnedBuffer(PinnedBuffer&& other) noexcept {
  *this = std::move(other);
}

// NOLINTNEXTLINE(bugprone-exception-escape)
PinnedBuffer& PinnedBuffer::operator=(PinnedBuffer&& other) noexcept {
  std::swap(queue_, other.queue_);
  std::swap(buffer_, other.buffer_);
  std::swap(bytes_, other.bytes_);
  std::swap(host_, other.host_);
  return *this;
}

}  // namespace broadcl::opencl
