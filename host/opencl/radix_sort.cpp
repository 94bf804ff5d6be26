#include "opencl/radix_sort.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <utility>

#include "opencl/common_program.hpp"
#include "opencl/launch.hpp"

namespace broadcl::opencl {
namespace {

constexpr std::size_t longest_sorted_block = 8 * sort_tile;

/// Approximate number of elements per bucket: enough that counters cost little in comparison.
constexpr std::size_t bucket = 2048;

/// Up to this many elements are a small number. (On a CPU, one work-item goes through all of them 16 times
/// for a range of 64 bits: see split_into_blocks. On a GPU, merging searches each tile for each element.)
std::size_t default_most_small(const Context& context) {
  return context.tuning() == Tuning::cpu ? 3584 : 16 * sort_tile;
}

/// Up to this many blocks, it takes a GPU less time to add up the counts in each work-group than to launch
/// their scan.
constexpr std::size_t most_unscanned = 64;

}  // namespace

RadixSort::RadixSort(const Context& context) : RadixSort(context, default_most_small(context)) {}

RadixSort::RadixSort(const Context& context, std::size_t most_small)
    : context_(context), most_small_(most_small), scan_(context) {
  const cl::Program program = common_program(context);
  const std::size_t group = common_group(context);
  count_ = context.kernel(program, "radix_sort_count", group);
  scatter_ = context.kernel(program, "radix_sort_scatter", group);
  small_ = context.kernel(program, "radix_sort_small", group);
  if (context.tuning() == Tuning::cpu) {
    buckets_ = context.kernel(program, "radix_sort_buckets", group);
  } else {
    merge_ = context.kernel(program, "radix_sort_merge", group);
  }
}

void RadixSort::enqueue_small(const cl::Buffer& elements, const cl::Buffer& scratch, cl_uint n, Bits key,
                              Profiler::Scope* stage) {
  const std::size_t group = common_group(context_);
  const auto enqueue = [&](cl::Kernel& kernel, std::size_t groups, const cl::Buffer& from,
                           const cl::Buffer& to) {
    set_arguments(kernel, 0, n, cl_uint{key.first}, cl_uint{key.count}, from, to);
    context_.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(groups * group),
                                          cl::NDRange(group), nullptr, event_of(stage));
  };
  if (context_.tuning() == Tuning::cpu) {
    enqueue(small_, 1, elements, scratch);
  } else if (n <= sort_tile) {
    enqueue(small_, 1, elements, elements);
  } else {
    enqueue(small_, divide_up(n, sort_tile), elements, scratch);
    enqueue(merge_, divide_up(n, group), scratch, elements);
  }
}

void RadixSort::enqueue_pass(const cl::Buffer& source, const cl::Buffer& target, cl_uint n, Blocks blocks,
                             Bits digit, Profiler::Scope* stage) {
  for (cl::Kernel* kernel : {&count_, &scatter_}) {
    set_arguments(*kernel, 0, n, blocks.length, cl_uint{digit.first}, cl_uint{digit.count}, source);
  }
  const bool scans = context_.tuning() == Tuning::cpu || blocks.count > most_unscanned;
  set_arguments(count_, 5, counts_);
  set_arguments(scatter_, 5, target, cl_uint{scans ? 1U : 0U}, counts_);
  const cl::NDRange group(common_group(context_));
  const cl::NDRange items(blocks.count * common_group(context_));
  context_.queue().enqueueNDRangeKernel(count_, cl::NullRange, items, group, nullptr, event_of(stage));
  if (scans) scan_.enqueue(counts_, counts_, std::size_t{blocks.count} << digit.count, stage);
  context_.queue().enqueueNDRangeKernel(scatter_, cl::NullRange, items, group, nullptr, event_of(stage));
}

void RadixSort::enqueue_digits(const cl::Buffer& elements, const cl::Buffer& scratch, cl_uint n,
                               Blocks blocks, const Keys& keys, Profiler::Scope* stage) {
  std::array<const cl::Buffer*, 2> buffers{&elements, &scratch};
  for (const Bits& key : {keys.minor, keys.major}) {
    // As few digits as possible, of about equal length.
    unsigned digits = (key.count + digit_bits - 1) / digit_bits;
    for (Bits digit{key.first, 0}; digits > 0; --digits, digit.first += digit.count) {
      digit.count = (key.first + key.count - digit.first + digits - 1) / digits;
      enqueue_pass(*buffers[0], *buffers[1], n, blocks, digit, stage);
      std::swap(buffers[0], buffers[1]);
    }
  }
  if (buffers[0] != &elements)
    context_.queue().enqueueCopyBuffer(scratch, elements, 0, 0, n * sizeof(cl_ulong), nullptr,
                                       event_of(stage));
}

void RadixSort::enqueue_buckets(const cl::Buffer& elements, const cl::Buffer& scratch, cl_uint n,
                                Blocks blocks, const Keys& keys, Profiler::Scope* stage) {
  Bits minor = keys.minor;
  Bits major = keys.major;
  if (major.count == 0) std::swap(minor, major);
  if (major.count == 0) return;
  const auto wanted = static_cast<unsigned>(std::bit_width(n / bucket));
  const unsigned count = std::min({major.count, digit_bits, wanted});
  major.count -= count;
  enqueue_pass(elements, scratch, n, blocks, {major.first + major.count, count}, stage);
  set_arguments(buckets_, 0, n, blocks.count, cl_uint4{{minor.first, minor.count, major.first, major.count}},
                elements, scratch, counts_);
  context_.queue().enqueueNDRangeKernel(buckets_, cl::NullRange, cl::NDRange(std::size_t{1} << count),
                                        cl::NDRange(1), nullptr, event_of(stage));
}

void RadixSort::enqueue(const cl::Buffer& elements, const cl::Buffer& scratch, std::size_t n,
                        const Keys& keys, Profiler::Scope* stage) {
  if (n < 2) return;
  const auto count = static_cast<cl_uint>(n);
  if (n <= most_small_) {
    for (const Bits& key : {keys.minor, keys.major}) {
      if (key.count > 0) enqueue_small(elements, scratch, count, key, stage);
    }
    return;
  }
  const Blocks blocks = split_into_blocks(context_, n, sort_tile, longest_sorted_block);
  if (blocks.count > most_blocks_) {
    counts_ = context_.buffer((std::size_t{blocks.count} << digit_bits) * sizeof(cl_uint));
    most_blocks_ = blocks.count;
  }
  if (context_.tuning() == Tuning::cpu) {
    enqueue_buckets(elements, scratch, count, blocks, keys, stage);
  } else {
    enqueue_digits(elements, scratch, count, blocks, keys, stage);
  }
}

}  // namespace broadcl::opencl
