#include "opencl/shared_buffer.hpp"

#include <utility>

namespace broadcl::opencl {

SharedBuffer::SharedBuffer(const Context& context, std::size_t bytes)
    : queue_(context.queue()), bytes_(bytes) {
  const bool shared = context.device().host_unified;
  device_ = context.buffer(bytes, shared ? CL_MEM_ALLOC_HOST_PTR : 0);
  if (!shared) pinned_ = context.pinned(bytes);
  cl::Event mapped;
  map(&mapped);
  mapped.wait();
}

SharedBuffer::~SharedBuffer() {
  if (host_ == nullptr) return;
  // A destructor cannot report: the C call, whose code is let go.
  const cl::Buffer& mapped = pinned_() != nullptr ? pinned_ : device_;
  (void)clEnqueueUnmapMemObject(queue_(), mapped(), host_, 0, nullptr, nullptr);
}

// Moving handles of the bindings does not throw, though they do not say so.
// NOLINTNEXTLINE(bugprone-exception-escape)
SharedBuffer::SharedBuffer(SharedBuffer&& other) noexcept {
  *this = std::move(other);
}

// NOLINTNEXTLINE(bugprone-exception-escape)
SharedBuffer& SharedBuffer::operator=(SharedBuffer&& other) noexcept {
  std::swap(queue_, other.queue_);
  std::swap(device_, other.device_);
  std::swap(pinned_, other.pinned_);
  std::swap(bytes_, other.bytes_);
  std::swap(host_, other.host_);
  return *this;
}

void SharedBuffer::map(cl::Event* event) {
  if (host_ != nullptr) return;
  const cl::Buffer& buffer = pinned_() != nullptr ? pinned_ : device_;
  host_ = static_cast<std::byte*>(
      queue_.enqueueMapBuffer(buffer, CL_FALSE, CL_MAP_READ | CL_MAP_WRITE, 0, bytes_, nullptr, event));
}

void SharedBuffer::unmap(cl::Event* event) {
  if (host_ == nullptr) return;
  queue_.enqueueUnmapMemObject(device_, host_, nullptr, event);
  host_ = nullptr;
}

void SharedBuffer::upload(std::size_t bytes, cl::Event* event) {
  if (pinned_() == nullptr) return unmap(event);
  queue_.enqueueWriteBuffer(device_, CL_FALSE, 0, bytes, host_, nullptr, event);
}

void SharedBuffer::lend(cl::Event* event) {
  if (pinned_() == nullptr) unmap(event);
}

void SharedBuffer::download(std::size_t bytes, cl::Event* event) {
  if (pinned_() == nullptr) return map(event);
  queue_.enqueueReadBuffer(device_, CL_FALSE, 0, bytes, host_, nullptr, event);
}

void SharedBuffer::reclaim(cl::Event* event) {
  if (pinned_() == nullptr) map(event);
}

}  // namespace broadcl::opencl
