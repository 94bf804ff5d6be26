#include "opencl/scan.hpp"

#include "opencl/blocks.hpp"
#include "opencl/common_program.hpp"
#include "opencl/launch.hpp"

namespace broadcl::opencl {
namespace {

/// Largest number of values per block; a work-item handles up to four per iteration.
constexpr std::size_t longest_block = std::size_t{1} << 17;
constexpr std::size_t most_blocks = (std::size_t{1} << 31) / longest_block;

}  // namespace

Scan::Scan(const Context& context) : context_(context) {
  const cl::Program program = common_program(context);
  const std::size_t group = context.launch().group;
  sums_ = context.kernel(program, "scan_sums", group);
  blocks_ = context.kernel(program, "scan_blocks", group);
  block_sums_ = context.buffer(most_blocks * sizeof(cl_uint));
}

void Scan::enqueue(const cl::Buffer& values, const cl::Buffer& to, std::size_t n, Profiler::Scope* stage) {
  if (n == 0) return;
  const std::size_t group = context_.launch().group;
  const Blocks blocks = split_into_blocks(context_, n, context_.launch().min_scan_block, longest_block);
  const auto enqueue_each = [&](cl::Kernel& kernel) {
    set_arguments(kernel, 0, static_cast<cl_uint>(n), blocks.length, values, block_sums_);
    context_.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(blocks.count * group),
                                          cl::NDRange(group), nullptr, event_of(stage));
  };
  if (blocks.count > 1) enqueue_each(sums_);
  set_arguments(blocks_, 4, to);
  enqueue_each(blocks_);
}

}  // namespace broadcl::opencl
