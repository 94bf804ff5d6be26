#include "opencl/shared_buffer.hpp"

namespace broadcl::opencl {

SharedBuffer::SharedBuffer(const Context& context, std::size_t bytes, bool direct) : queue_(context.queue()) {
  if (context.device().host_unified) {
    host_ = share(context, MappedBuffer(context, context.buffer(bytes, CL_MEM_ALLOC_HOST_PTR), bytes));
  } else if (direct && context.has_direct_memory()) {
    host_ = share(context, MappedBuffer::direct(context, bytes, CL_FALSE));
  } else {
    device_ = context.buffer(bytes);
    host_ = share(context, MappedBuffer(context, context.pinned(bytes), bytes));
    host_->map();
  }
}

void SharedBuffer::release() {
  if (device_() == nullptr && !is_direct()) host_->unmap();
}

void SharedBuffer::download(std::size_t bytes, cl::Event* event) {
  if (device_() == nullptr) return host_->map(CL_FALSE, event);
  queue_.enqueueReadBuffer(device_, CL_FALSE, 0, bytes, host_->host(), nullptr, event);
}

}  // namespace broadcl::opencl
