#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <array>
#include <span>
#include <string>

#include <gtest/gtest.h>

#include "each_algorithm.hpp"
#include "opencl/context.hpp"
#include "opencl/mapped_buffer.hpp"
#include "opencl/shared_buffer.hpp"
#include "patience.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"

/// Use of device memory.
namespace broadcl::test {
namespace {

using scenes::MovingBoxes;

TEST(Memory, BuffersCountUntilNothingRefersToThem) {
  const opencl::Context context(select_device(), false);
  EXPECT_EQ(context.memory().device, 0U);
  {
    const cl::Buffer first = context.buffer(1000);
    EXPECT_EQ(context.memory().device, 1000U);
    cl::Buffer second = context.buffer(500);
    const cl::Buffer same = second;
    second = {};
    EXPECT_EQ(context.memory().device, 1500U);
  }
  EXPECT_TRUE(eventually([&] { return context.memory().device == 0; }));
  EXPECT_EQ(context.memory().device_peak, 1500U);
  EXPECT_EQ(context.memory().pinned, 0U);
  {
    const auto pinned = opencl::MappedBuffer::pinned(context, 100);
    EXPECT_EQ(context.memory().pinned, 100U);
    const opencl::SharedBuffer shared(context, 10);
    EXPECT_EQ(context.memory().device, 10U);
    EXPECT_EQ(context.memory().pinned, context.device().host_unified ? 100U : 110U);
  }
  context.queue().finish();  // the commands that unmap them may hold them until then
  EXPECT_TRUE(eventually([&] { return context.memory().pinned == 0; }));
  EXPECT_TRUE(eventually([&] { return context.memory().device == 0; }));
  EXPECT_EQ(context.memory().device_peak, 1500U);
}

TEST(Memory, AlgorithmsOfTheHostHaveNoneOnADevice) {
  BroadPhase broad_phase({.algorithm = "oracle"});
  broad_phase.add(unit);
  (void)broad_phase.update();
  EXPECT_EQ(broad_phase.memory().device, 0U);
  EXPECT_EQ(broad_phase.memory().device_peak, 0U);
  EXPECT_EQ(broad_phase.memory().pinned, 0U);
}

/// The largest permitted use for n boxes and the most pairs of a frame, with capacity to grow.
std::size_t allowed(std::size_t boxes, std::size_t pairs) {
  constexpr std::size_t fixed = 1 << 20;  // for any number of boxes
  return (128 * boxes + 40 * pairs) * 3 / 2 + fixed;
}

class MemoryOf : public ::testing::TestWithParam<std::string> {};

NOT_IN(sanitizers, "takes long; measures memory of the device");
TEST_P(MemoryOf, BoxesAndPairsIsBounded) {
  for (const MovingBoxes::Sizes sizes : {MovingBoxes::Sizes::uniform, MovingBoxes::Sizes::mixed}) {
    for (const std::uint32_t n : {1000U, 10'000U, 40'000U}) {
      if (n > 1000 && is_slow_device()) continue;
      if (n > 10'000 && GetParam() == "brute-force") continue;
      for (const bool one_by_one : {false, true}) {
        MovingBoxes scene(n, sizes);
        BroadPhase broad_phase({.algorithm = GetParam()});
        std::size_t pairs = 0;
        std::size_t most = 0;
        for (int frame = 0; frame < 20; ++frame) {
          if (one_by_one) {
            for (std::uint32_t id = 0; id < n; ++id) {
              if (frame == 0) broad_phase.add(scene.boxes()[id]);
              broad_phase.move(id, scene.boxes()[id]);
            }
          } else {
            std::ranges::copy(scene.boxes(), broad_phase.map(n).begin());
          }
          const Delta delta = broad_phase.update();
          pairs = pairs + delta.added.size() - delta.removed.size();
          most = std::max(most, pairs);
          scene.advance();
        }
        const MemoryUse memory = broad_phase.memory();
        const std::string what = std::to_string(n) + (sizes == MovingBoxes::Sizes::mixed ? " mixed" : "") +
                                 (one_by_one ? ", one by one" : "");
        EXPECT_GE(memory.device, std::size_t{52} * n + 24 * most) << what;
        EXPECT_LE(memory.device, allowed(n, most)) << what;
        EXPECT_LE(memory.device_peak, allowed(n, most)) << what;
      }
    }
  }
}

/// In each frame the number of pairs doubles, or all pairs change.
TEST_P(MemoryOf, PairsThatMultiplyOrChangeAllAtOnceIsBounded) {
  constexpr std::uint32_t n = 3000;
  const std::array scenes{MovingBoxes(n, MovingBoxes::Sizes::mixed, 1),
                          MovingBoxes(n, MovingBoxes::Sizes::mixed, 2)};
  for (const bool multiply : {true, false}) {
    BroadPhase broad_phase({.algorithm = GetParam()});
    std::size_t pairs = 0;
    std::size_t most = 0;  // in a frame and the one before it together
    float size = multiply ? 0.1F : 1;
    for (std::size_t frame = 0; frame < 12; ++frame, size *= multiply ? 1.26F : 1) {
      const std::span<const Aabb> boxes = scenes.at(multiply ? 0 : frame % 2).boxes();
      std::ranges::transform(boxes, broad_phase.map(n).begin(), [&](Aabb box) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const float middle = (box.lower[axis] + box.upper[axis]) / 2;
          box.lower[axis] = middle + (box.lower[axis] - middle) * size;
          box.upper[axis] = middle + (box.upper[axis] - middle) * size;
        }
        return box;
      });
      const Delta delta = broad_phase.update();
      most = std::max(most, pairs + delta.added.size());
      pairs = pairs + delta.added.size() - delta.removed.size();
      EXPECT_LE(broad_phase.memory().device_peak, allowed(n, most)) << "frame " << frame << ", " << pairs;
    }
    EXPECT_GT(pairs, 5 * n);
  }
}

INSTANTIATE_TEST_SUITE_P(Table, MemoryOf, ::testing::Values("brute-force", "tiles"), named_by_parameter);

}  // namespace
}  // namespace broadcl::test
