#include "algorithms/pair_delta.hpp"

#include <vector>

#include <gtest/gtest.h>

#include <broadcl/aabb.hpp>

#include "algorithms/device_boxes.hpp"
#include "expect_error.hpp"

namespace broadcl {
namespace {

using ::testing::HasSubstr;

/// The device's memory runs out in the middle of a frame: an error with the numbers, and the pairs of the
/// last frame are known as before, so that the next, smaller frame has the right changes.
TEST(PairDelta, ExhaustedMemoryLeavesTheLastFrameKnown) {
  constexpr cl_uint n = 600;
  Device device = select_device();
  device.max_allocation = 1 << 20;  // room for 131,072 pairs, not for 179,700
  const opencl::Context context(device, false);
  opencl::Profiler profiler(false);
  PairDelta delta(context, profiler);
  const unsigned width = 4;
  cl::Kernel kernel(context.program("brute_force.cl", "-DWIDTH=4 -DGROUP=1"), "brute_force");
  DeviceBoxes boxes;
  boxes.reserve(context, n);
  const auto find = [&] {
    boxes.upload(n, nullptr);
    kernel.setArg(0, n);
    kernel.setArg(1, n);
    kernel.setArg(2, boxes.device());
    delta.set_sink(kernel, 3);
    context.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(n / width, 1), cl::NDRange(1, 1));
    boxes.reclaim();
  };
  const auto place = [&](cl_uint together) {
    for (cl_uint k = 0; k < n; ++k) {
      const float x = k < together ? 0 : 2 * static_cast<float>(k);
      boxes.host()[k] = {{x, 0, 0}, {x + 1, 1, 1}};
    }
  };

  place(20);
  EXPECT_EQ(delta.update(n, {}, find).added.size(), 190U);
  place(n);
  EXPECT_THAT(test::error_of([&] { delta.update(n, {}, find); }), HasSubstr("1048576"));
  EXPECT_EQ(delta.pairs().size(), 190U);
  place(19);
  const Delta changes = delta.update(n, {}, find);
  EXPECT_TRUE(changes.added.empty());
  EXPECT_EQ(changes.removed.size(), 19U);
  EXPECT_EQ(delta.pairs().size(), 171U);
}

}  // namespace
}  // namespace broadcl
