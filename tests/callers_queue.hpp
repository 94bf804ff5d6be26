#pragma once

#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <broadcl/opencl.hpp>

#include "each_algorithm.hpp"
#include "opencl/devices.hpp"

namespace broadcl::test {

/// A caller's queue, and buffers in its context.
class CallersQueue {
 public:
  explicit CallersQueue(cl_command_queue_properties properties = 0) : queue_(context_, device_, properties) {}

  template <class T>
  [[nodiscard]] cl::Buffer buffer_of(const std::vector<T>& values) const {
    const std::size_t bytes = std::max<std::size_t>(1, values.size() * sizeof(T));
    cl::Buffer buffer(context_, CL_MEM_READ_WRITE, bytes);
    if (!values.empty()) queue_.enqueueWriteBuffer(buffer, CL_TRUE, 0, bytes, values.data());
    return buffer;
  }

  /// The four numbers that enqueue() reports.
  [[nodiscard]] std::array<std::uint32_t, 4> read_counts(const cl::Buffer& counts) const {
    std::array<std::uint32_t, 4> words{};
    queue_.enqueueReadBuffer(counts, CL_TRUE, 0, sizeof words, words.data());
    return words;
  }

  template <class T>
  [[nodiscard]] std::vector<T> read(cl_mem buffer, std::size_t count) const {
    std::vector<T> values(count);
    if (count > 0)
      queue_.enqueueReadBuffer(cl::Buffer(buffer, true), CL_TRUE, 0, count * sizeof(T), values.data());
    return values;
  }
  [[nodiscard]] Pairs read(const DeviceBroadPhase::PairBuffer& list) const {
    return read<Pair>(list.buffer, list.count);
  }

  [[nodiscard]] cl_command_queue operator()() const { return queue_(); }

 protected:
  cl::Device device_{opencl::open(select_device())};
  cl::Context context_{device_};
  cl::CommandQueue queue_;
};

}  // namespace broadcl::test
