#include "opencl/shared_buffer.hpp"

#include <utility>

#include "opencl/launch.hpp"
#include "opencl/process.hpp"

namespace broadcl::opencl {

SharedBuffer::SharedBuffer(const Context& context, std::size_t bytes, bool direct) : queue_(context.queue()) {
  if (context.device().host_unified) {
    *host_ = MappedBuffer(context, context.buffer(bytes, CL_MEM_ALLOC_HOST_PTR), bytes);
  } else if (direct && context.has_direct_memory()) {
    *host_ = MappedBuffer::direct(context, bytes, CL_FALSE);
  } else {
    device_ = context.buffer(bytes);
    *host_ = MappedBuffer(context, context.pinned(bytes), bytes);
    host_->map();
  }
  // Whoever has a copy last waits until the memory is released: Context, which waits for its queue, may be
  // gone.
  struct Owner {
    cl::CommandQueue queue;
    std::shared_ptr<MappedBuffer> host;
  };
  owner_ = std::shared_ptr<const Owner>(new Owner{queue_, host_}, [](const Owner* owner) {
    if (is_forked()) return;
    const cl::CommandQueue queue = owner->queue;
    const std::weak_ptr<MappedBuffer> buffer = owner->host;
    delete owner;
    if (buffer.expired()) wait_if_possible(queue);
  });
}

// NOLINTNEXTLINE(bugprone-exception-escape): handles do not throw when moved
SharedBuffer& SharedBuffer::operator=(SharedBuffer&& other) noexcept {
  owner_ = std::move(other.owner_);
  host_ = std::move(other.host_);
  device_ = std::move(other.device_);
  queue_ = std::move(other.queue_);
  return *this;
}

void SharedBuffer::release() {
  if (device_() == nullptr && !is_direct()) host_->unmap();
}

void SharedBuffer::download(std::size_t bytes, cl::Event* event) {
  if (device_() == nullptr) return host_->map(CL_FALSE, event);
  queue_.enqueueReadBuffer(device_, CL_FALSE, 0, bytes, host_->host(), nullptr, event);
}

}  // namespace broadcl::opencl
