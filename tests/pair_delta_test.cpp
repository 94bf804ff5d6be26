#include "algorithms/pair_delta.hpp"

#include <vector>

#include <gtest/gtest.h>

#include <broadcl/aabb.hpp>

#include "algorithms/device_objects.hpp"
#include "expect_error.hpp"

namespace broadcl {
namespace {

using ::testing::HasSubstr;

/// The device's memory runs out in the middle of a frame: an error with the numbers, and the pairs of the
/// last frame are known as before, so that the next, smaller frame has the right changes.
TEST(PairDelta, ExhaustedMemoryLeavesTheLastFrameKnown) {
  static constexpr cl_uint n = 600;
  Device device = select_device();
  device.max_allocation = 1 << 20;  // room for 131,072 pairs, not for 179,700
  const opencl::Context context(device, false);
  opencl::Profiler profiler(false);
  PairDelta delta(context, profiler);
  cl::Kernel kernel(context.program("brute_force.cl", "-DWIDTH=4 -DGROUP=1 -DMAX_ROWS=600"), "brute_force");
  DeviceObjects objects(context, profiler);
  objects.reserve(n);
  const auto update = [&] {
    const Search search = objects.upload({.slots = n, .all = true});
    const auto find = [&, search] {
      objects.lend();
      cl_uint k = 0;
      for (const cl_uint number : {n, n, n}) kernel.setArg(k++, number);
      kernel.setArg(k++, search.boxes);
      kernel.setArg(k++, search.changed);
      kernel.setArg(k++, cl_uint{0});
      kernel.setArg(k++, search.filters);
      delta.set_sink(kernel, k);
      constexpr unsigned width = 4;
      context.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(n / width, 1),
                                           cl::NDRange(1, 1));
      objects.reclaim();
    };
    delta.begin({.slots = n, .stamps = search.stamps, .find = find});
    return delta.finish();
  };
  const auto place = [&](cl_uint together) {
    for (cl_uint k = 0; k < n; ++k) {
      const float x = k < together ? 0 : 2 * static_cast<float>(k);
      objects.boxes()[k] = {{x, 0, 0}, {x + 1, 1, 1}};
    }
  };

  place(20);
  EXPECT_EQ(update().added.size(), 190U);
  place(n);
  EXPECT_THAT(test::error_of([&] { update(); }), HasSubstr("1048576"));
  EXPECT_EQ(delta.pairs().size(), 190U);
  place(19);
  const Delta changes = update();
  EXPECT_TRUE(changes.added.empty());
  EXPECT_EQ(changes.removed.size(), 19U);
  EXPECT_EQ(delta.pairs().size(), 171U);
}

}  // namespace
}  // namespace broadcl
