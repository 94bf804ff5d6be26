#include "opencl/growing_buffer.hpp"

#include <algorithm>
#include <string>

#include <broadcl/error.hpp>

namespace broadcl::opencl {

void refuse_too_large(const Context& context, std::size_t bytes, std::string_view what, std::uint64_t most) {
  if (bytes <= most) return;
  throw Error(context.device().label() + ": needs a buffer of " + std::to_string(bytes) + " bytes for the " +
                  std::string(what) + ", but the device allocates at most " + std::to_string(most) +
                  "; use fewer boxes, another algorithm or a device with more memory",
              ErrorKind::out_of_device_memory);
}

std::size_t grown(const Context& context, std::size_t bytes, std::string_view what, std::uint64_t most) {
  refuse_too_large(context, bytes, what, most);
  return std::min<std::uint64_t>(most, std::uint64_t{bytes} + bytes / 4);
}

void GrowingBuffer::reserve(const Context& context, std::size_t bytes, std::string_view what) {
  if (bytes <= bytes_) return;
  const std::size_t size = grown(context, bytes, what);
  clear();
  buffer_ = context.buffer(size);
  bytes_ = size;
}

}  // namespace broadcl::opencl
