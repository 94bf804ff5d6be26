#include "opencl/mapped_buffer.hpp"

#include <utility>

#include "opencl/launch.hpp"
#include "opencl/process.hpp"

namespace broadcl::opencl {

MappedBuffer::MappedBuffer(const Context& context, cl::Buffer buffer, std::size_t bytes)
    : queue_(context.queue()), buffer_(std::move(buffer)), bytes_(bytes) {}

MappedBuffer MappedBuffer::pinned(const Context& context, std::size_t bytes) {
  MappedBuffer result(context, context.pinned(bytes), bytes);
  result.map(CL_TRUE);
  return result;
}

MappedBuffer MappedBuffer::direct(const Context& context, std::size_t bytes, cl_bool blocking) {
  MappedBuffer result(context, context.direct(bytes), bytes);
  result.is_direct_ = true;
  result.map(blocking);
  return result;
}

MappedBuffer::~MappedBuffer() {
  if (host_ == nullptr) return;
  // A destructor cannot report errors: hence the C call, whose error code is ignored.
  (void)clEnqueueUnmapMemObject(queue_(), buffer_(), host_, 0, nullptr, nullptr);
}

// Moving handles of the bindings does not throw, though they do not say so.
// NOLINTNEXTLINE(bugprone-exception-escape)
MappedBuffer::MappedBuffer(MappedBuffer&& other) noexcept {
  *this = std::move(other);
}

// NOLINTNEXTLINE(bugprone-exception-escape)
MappedBuffer& MappedBuffer::operator=(MappedBuffer&& other) noexcept {
  std::swap(queue_, other.queue_);
  std::swap(buffer_, other.buffer_);
  std::swap(bytes_, other.bytes_);
  std::swap(is_direct_, other.is_direct_);
  std::swap(host_, other.host_);
  return *this;
}

std::shared_ptr<MappedBuffer> share(const Context& context, MappedBuffer buffer) {
  const auto end = [life = context.life()](const MappedBuffer* shared) {
    if (is_forked()) return;
    const cl::CommandQueue queue = shared->queue();
    delete shared;
    if (life.expired()) wait_if_possible(queue);
  };
  return {new MappedBuffer(std::move(buffer)), end};
}

void MappedBuffer::map(cl_bool blocking, cl::Event* event) {
  if (host_ != nullptr) return;
  host_ = static_cast<std::byte*>(
      queue_.enqueueMapBuffer(buffer_, blocking, CL_MAP_READ | CL_MAP_WRITE, 0, bytes_, nullptr, event));
}

void MappedBuffer::unmap() {
  if (host_ == nullptr) return;
  queue_.enqueueUnmapMemObject(buffer_, host_);
  host_ = nullptr;
}

}  // namespace broadcl::opencl
