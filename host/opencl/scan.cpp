#include "opencl/scan.hpp"

#include <string>

#include "opencl/blocks.hpp"
#include "opencl/launch.hpp"

namespace broadcl::opencl {
namespace {

/// Launch parameters.
struct Launch {
  std::size_t group;  ///< Work-items per work-group.
  std::size_t tile;   ///< Values per block, at least; a multiple of 4 * group.
};

constexpr Launch gpu_launch{.group = 256, .tile = 4096};
constexpr Launch cpu_launch{.group = 1, .tile = 16384};

/// Values per block, at most: a work-item handles up to four per iteration.
constexpr std::size_t longest_block = std::size_t{1} << 17;
constexpr std::size_t most_blocks = (std::size_t{1} << 31) / longest_block;

const Launch& launch_of(const Context& context) {
  return context.tuning() == Tuning::cpu ? cpu_launch : gpu_launch;
}

}  // namespace

Scan::Scan(const Context& context) : context_(context) {
  const cl::Program program =
      context.program("scan.cl", "-DGROUP=" + std::to_string(launch_of(context).group));
  sums_ = context.kernel(program, "scan_sums", launch_of(context).group);
  blocks_ = context.kernel(program, "scan_blocks", launch_of(context).group);
  block_sums_ = context.buffer(most_blocks * sizeof(cl_uint));
}

void Scan::enqueue(const cl::Buffer& values, std::size_t n) {
  if (n == 0) return;
  const std::size_t group = launch_of(context_).group;
  const Blocks blocks = split_into_blocks(context_, n, launch_of(context_).tile, longest_block);
  const auto enqueue_blocks = [&](const cl::Buffer& list, Blocks split, std::size_t size) {
    set_arguments(blocks_, 0, static_cast<cl_uint>(size), split.length, list, block_sums_);
    context_.queue().enqueueNDRangeKernel(blocks_, cl::NullRange, cl::NDRange(split.count * group),
                                          cl::NDRange(group));
  };
  if (blocks.count > 1) {
    set_arguments(sums_, 0, static_cast<cl_uint>(n), blocks.length, values, block_sums_);
    context_.queue().enqueueNDRangeKernel(sums_, cl::NullRange, cl::NDRange(blocks.count * group),
                                          cl::NDRange(group));
    enqueue_blocks(block_sums_, {.count = 1, .length = blocks.count}, blocks.count);
  }
  enqueue_blocks(values, blocks, n);
}

}  // namespace broadcl::opencl
