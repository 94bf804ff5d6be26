#pragma once

#include <cstddef>

#include "opencl/api.hpp"
#include "opencl/blocks.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"
#include "opencl/scan.hpp"

namespace broadcl::opencl {

/// Stable sorting of 8-byte elements on the device: kernels/radix_sort.cl, which names the sources.
///
/// It makes one pass over the elements for every 8 bits, or fewer, of each range; if there are few elements,
/// on a GPU, one or two launches per range.
class RadixSort {
 public:
  /// A range of the bits of an element, read as the 64-bit number that it is on a little-endian device: bit 0
  /// is the lowest of its first uint. first + count is at most 64.
  struct Bits {
    unsigned first;
    unsigned count;
  };

  /// What to sort by: two ranges that do not overlap, or one, if the other has no bits.
  struct Keys {
    Bits minor{0, 0};
    Bits major{0, 0};
  };

  /// @param context Must outlive this object.
  /// @throws Error, cl::Error
  explicit RadixSort(const Context& context) : RadixSort(context, context.launch().max_merged) {}
  /// The same, for tests.
  RadixSort(const Context& context, std::size_t max_merged);

  /// Enqueues a stable ascending sort, in place. Does not wait. Sorts by one object must be enqueued one
  /// after the other, as by a single thread. The object's memory, for counters, is at most 1 KiB per 4096
  /// elements, and grows before anything is enqueued.
  ///
  /// For instance, {{32, 32}} sorts {value, key}, and kernels/pair.h has the bits of a pair.
  /// @param elements, scratch Two buffers of at least n elements each. Scratch is overwritten.
  /// @param n Less than 2^31, otherwise an Error is thrown.
  /// @param stage To which the commands belong; null if to none.
  /// @throws cl::Error
  void enqueue(const cl::Buffer& elements, const cl::Buffer& scratch, std::size_t n, const Keys& keys,
               Profiler::Scope* stage = nullptr);

 private:
  void enqueue_merged(const cl::Buffer& elements, const cl::Buffer& scratch, cl_uint n, Bits key,
                      Profiler::Scope* stage);
  void enqueue_pass(const cl::Buffer& source, const cl::Buffer& target, cl_uint n, Blocks blocks, Bits digit,
                    Profiler::Scope* stage);

  const Context& context_;
  std::size_t max_merged_;
  Scan scan_;
  cl::Kernel count_, scatter_;
  cl::Kernel small_, merge_;  // with the tuning for GPUs
  cl::Buffer counts_;         // by digit, then by block
  cl_uint most_blocks_ = 0;   // blocks that counts_ has capacity for
};

}  // namespace broadcl::opencl
