#include "opencl/arithmetic.hpp"

#include <array>
#include <limits>
#include <string>

#include <broadcl/error.hpp>

#include "opencl/kernel_source.hpp"
#include "opencl/launch.hpp"

namespace broadcl::opencl {
namespace {

#include "../../kernels/arithmetic.h"  // NOLINT(misc-include-cleaner)

using Float = std::numeric_limits<float>;
constexpr std::array numbers{0.0F, -0.0F,        Float::denorm_min(), 3 * Float::denorm_min(),
                             1.0F, Float::max(), Float::infinity(),   Float::quiet_NaN()};

cl_uint measure_arithmetic(const Context& context) {
  cl::Kernel kernel = context.kernel(context.program("arithmetic.cl"), "arithmetic", 1);
  const cl::Buffer input(context.context(), CL_MEM_READ_ONLY, sizeof numbers);
  const cl::Buffer output(context.context(), CL_MEM_WRITE_ONLY, sizeof(cl_uint));
  const cl::CommandQueue& queue = context.queue();
  queue.enqueueWriteBuffer(input, CL_TRUE, 0, sizeof numbers, numbers.data());
  set_arguments(kernel, 0, input, output);
  queue.enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(1), cl::NDRange(1));
  cl_uint result = 0;
  queue.enqueueReadBuffer(output, CL_TRUE, 0, sizeof result, &result);
  return result;
}

}  // namespace

bool flushes_denormals(const Context& context) {
  const std::string key = "arithmetic" + kernel_source("arithmetic.cl");
  cl_uint result = 0;
  if (const auto stored = context.disk_cache().load(key); stored.size() == 1) {
    result = stored.front();
  } else {
    result = measure_arithmetic(context);
    (void)context.disk_cache().store(key, {static_cast<DiskCache::Bytes::value_type>(result)});
  }
  if ((result & HAS_NEEDED) != HAS_NEEDED) {
    throw Error(context.device().label() +
                ": the device does not compare zeros, infinities or NaNs as IEEE 754 says (" +
                std::to_string(result) + "), so pairs would be wrong; use another device or driver");
  }
  return (result & HAS_DENORMALS) == 0;
}

}  // namespace broadcl::opencl
