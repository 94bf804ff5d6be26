#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include <cstddef>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

#include "device_twins.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "scenes/generators.hpp"

/// Changes on the device, in the order of their worlds.
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

class OrderedWorlds : public ::testing::Test, protected CallersQueue {
 protected:
  /// Moves boxes over some frames and waits for every third only.
  void follow(std::uint32_t n, std::uint32_t worlds, std::uint32_t frames) {
    scenes::MovingBoxes motion(n, scenes::MovingBoxes::Sizes::mixed);
    DeviceTwins twins(*this, {.algorithm = "tiles"});
    twins.reserve(n, std::size_t{n} * 40);
    DeviceFrame now{.filters = std::vector<Filter>(n), .worlds = true, .ordered_worlds = worlds};
    for (std::uint32_t frame = 0; frame < frames; ++frame) {
      motion.advance();
      now.boxes.assign(motion.boxes().begin(), motion.boxes().end());
      for (std::uint32_t k = 0; k < n; ++k) {
        // Some are in all worlds, some in worlds beyond the ordered ones, and some change.
        const std::uint32_t shift = k % 50 == 0 ? frame : 0U;
        now.filters[k].world = k % 11 == 3 ? Filter::all_worlds : (k + shift) % (worlds + 2);
      }
      if (frame % 3 == 0) {
        ASSERT_TRUE(twins.update(now)) << "frame " << frame;
      } else {
        twins.enqueue(now, std::size_t{40} * n);
        ASSERT_FALSE(twins.is_halted());
        ASSERT_TRUE(twins.agree()) << "frame " << frame;
      }
    }
  }
};

SUITE_ALSO_IN(OrderedWorlds, gpu_profile | rusticl);

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_F(OrderedWorlds, SmallOnesHaveTheirChanges) {
  follow(90, 3, 4);
}

TEST_F(OrderedWorlds, HaveTheirChanges) {
  follow(1000, 15, 7);
}

TEST_F(OrderedWorlds, AsManyAsObjects) {
  follow(400, 400, 4);
}

/// One world has more changes than are sorted by comparing each with every other.
TEST_F(OrderedWorlds, ManyChangesInOne) {
  DeviceFrame frame{.boxes = std::vector<Aabb>(150, unit),
                    .filters = std::vector<Filter>(150),
                    .worlds = true,
                    .ordered_worlds = 2};
  for (std::uint32_t k = 0; k < 20; ++k) frame.filters[k].world = 1;
  DeviceTwins twins(*this, {});
  EXPECT_TRUE(twins.update(frame));
  EXPECT_GT(twins.pairs().size(), 4096U);
  EXPECT_TRUE(twins.update({.boxes = {}, .ordered_worlds = 2}));
}

TEST_F(OrderedWorlds, BuffersForOffsetsAreChecked) {
  const cl::Buffer boxes = buffer_of(std::vector<Aabb>(10, unit));
  const cl::Buffer pairs = buffer_of(Pairs(45));
  const cl::Buffer counts = buffer_of(std::vector<std::uint32_t>(4));
  DeviceBroadPhase broad_phase(queue_());
  broad_phase.reserve(10, 45);
  DeviceBroadPhase::ChangeBuffers changes{
      .added = pairs(), .removed = pairs(), .capacity = 45, .counts = counts(), .added_offsets = counts()};
  EXPECT_THAT(
      error_of([&] { broad_phase.enqueue({.buffer = boxes(), .count = 10, .ordered_worlds = 2}, changes); }),
      HasSubstr("removed offsets is null"));
  changes.removed_offsets = counts();
  EXPECT_THAT(
      error_of([&] { broad_phase.enqueue({.buffer = boxes(), .count = 10, .ordered_worlds = 3}, changes); }),
      HasSubstr("added offsets has 16 bytes, too few for 5"));
}

}  // namespace
}  // namespace broadcl::test
