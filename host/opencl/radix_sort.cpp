#include "opencl/radix_sort.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "opencl/common_program.hpp"
#include "opencl/launch.hpp"

namespace broadcl::opencl {
namespace {

/// Elements per tile: TILE in kernels/radix_tile.h. Blocks consist of tiles.
constexpr std::size_t sort_tile = 4096;
constexpr std::size_t longest_sorted_block = 8 * sort_tile;

/// Up to this many blocks, it takes less time to add up the counts in each work-group than to launch their
/// scan.
constexpr std::size_t most_unscanned = 64;

}  // namespace

RadixSort::RadixSort(const Context& context, std::size_t max_merged)
    : context_(context), max_merged_(max_merged), scan_(context) {
  const cl::Program program = common_program(context);
  const std::size_t group = context.launch().group;
  count_ = context.kernel(program, "radix_sort_count", group);
  scatter_ = context.kernel(program, "radix_sort_scatter", group);
  if (max_merged == 0) return;
  small_ = context.kernel(program, "radix_sort_small", group);
  merge_ = context.kernel(program, "radix_sort_merge", group);
}

void RadixSort::enqueue_merged(const cl::Buffer& elements, const cl::Buffer& scratch, cl_uint n, Bits key,
                               Profiler::Scope* stage) {
  const std::size_t group = context_.launch().group;
  const auto enqueue = [&](cl::Kernel& kernel, std::size_t groups, const cl::Buffer& from,
                           const cl::Buffer& to) {
    set_arguments(kernel, 0, n, cl_uint{key.first}, cl_uint{key.count}, from, to);
    context_.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(groups * group),
                                          cl::NDRange(group), nullptr, event_of(stage));
  };
  if (n <= sort_tile) return enqueue(small_, 1, elements, elements);
  enqueue(small_, divide_up(n, sort_tile), elements, scratch);
  enqueue(merge_, divide_up(n, group), scratch, elements);
}

void RadixSort::enqueue_pass(const cl::Buffer& source, const cl::Buffer& target, cl_uint n, Blocks blocks,
                             Bits digit, Profiler::Scope* stage) {
  for (cl::Kernel* kernel : {&count_, &scatter_}) {
    set_arguments(*kernel, 0, n, blocks.length, cl_uint{digit.first}, cl_uint{digit.count}, source);
  }
  const bool scans = blocks.count > most_unscanned;
  set_arguments(count_, 5, counts_);
  set_arguments(scatter_, 5, target, cl_uint{scans ? 1U : 0U}, counts_);
  const cl::NDRange group(context_.launch().group);
  const cl::NDRange items(blocks.count * context_.launch().group);
  context_.queue().enqueueNDRangeKernel(count_, cl::NullRange, items, group, nullptr, event_of(stage));
  if (scans) scan_.enqueue(counts_, counts_, std::size_t{blocks.count} << digit.count, stage);
  context_.queue().enqueueNDRangeKernel(scatter_, cl::NullRange, items, group, nullptr, event_of(stage));
}

void RadixSort::enqueue(const cl::Buffer& elements, const cl::Buffer& scratch, std::size_t n,
                        const Keys& keys, Profiler::Scope* stage) {
  if (n < 2) return;
  if (n <= max_merged_) {
    for (const Bits& key : {keys.minor, keys.major}) {
      if (key.count > 0) enqueue_merged(elements, scratch, static_cast<cl_uint>(n), key, stage);
    }
    return;
  }
  const Blocks blocks = split_into_blocks(context_, n, sort_tile, longest_sorted_block);
  if (blocks.count > most_blocks_) {
    counts_ = context_.buffer((std::size_t{blocks.count} << digit_bits) * sizeof(cl_uint));
    most_blocks_ = blocks.count;
  }
  std::array<const cl::Buffer*, 2> buffers{&elements, &scratch};
  for (const Bits& key : {keys.minor, keys.major}) {
    // As few digits as possible, of about equal length.
    unsigned digits = (key.count + digit_bits - 1) / digit_bits;
    for (Bits digit{key.first, 0}; digits > 0; --digits, digit.first += digit.count) {
      digit.count = (key.first + key.count - digit.first + digits - 1) / digits;
      enqueue_pass(*buffers[0], *buffers[1], static_cast<cl_uint>(n), blocks, digit, stage);
      std::swap(buffers[0], buffers[1]);
    }
  }
  if (buffers[0] != &elements)
    context_.queue().enqueueCopyBuffer(scratch, elements, 0, 0, n * sizeof(cl_ulong), nullptr,
                                       event_of(stage));
}

}  // namespace broadcl::opencl
