#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "device_life.hpp"
#include "each_algorithm.hpp"
#include "scenes/generators.hpp"
#include "scenes/random.hpp"
#include "twins.hpp"

namespace broadcl::test {
namespace {

/// Objects of several worlds in the same space: how they are spread over the worlds, and boxes that move.
class SceneOfWorlds {
 public:
  /// @param world_of The world of an object.
  SceneOfWorlds(std::uint32_t objects, std::uint32_t boxes_in_place,
                const std::function<std::uint32_t(std::uint32_t)>& world_of)
      : motion_(objects, scenes::MovingBoxes::Sizes::mixed),
        // As crowded as a single world of this many boxes would be.
        scale_(scenes::MovingBoxes(boxes_in_place, scenes::MovingBoxes::Sizes::mixed).edge() /
               motion_.edge()) {
    for (std::uint32_t k = 0; k < objects; ++k) filters_.push_back({.world = world_of(k)});
  }

  void advance() { motion_.advance(); }
  [[nodiscard]] std::vector<Aabb> boxes() const {
    std::vector<Aabb> boxes(motion_.boxes().begin(), motion_.boxes().end());
    for (Aabb& box : boxes) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float centre = (box.lower[axis] + box.upper[axis]) / 2;
        const float half = scale_ * (box.upper[axis] - box.lower[axis]) / 2;
        box.lower[axis] = centre - half;
        box.upper[axis] = centre + half;
      }
    }
    return boxes;
  }
  [[nodiscard]] std::vector<Filter>& filters() noexcept { return filters_; }

 private:
  scenes::MovingBoxes motion_;
  float scale_;
  std::vector<Filter> filters_;
};

/// With an algorithm, from the host and on the device, a scene in motion must have the oracle's pairs. In the
/// last frames some objects change worlds.
void follow_oracle(const std::string& algorithm, bool on_device, SceneOfWorlds scene) {
  Twins twins({.algorithm = algorithm});
  std::vector<Aabb> boxes = scene.boxes();
  std::vector<Filter>& filters = scene.filters();
  const auto n = static_cast<std::uint32_t>(boxes.size());
  for (std::uint32_t k = 0; k < n; ++k) twins.add(boxes[k], filters[k]);
  ASSERT_TRUE(twins.agree());

  const CallersQueue queue;
  std::optional<DeviceBroadPhase> device_broad_phase;
  if (on_device && algorithm != "gpu-bf")
    device_broad_phase.emplace(queue(), DeviceBroadPhase::Config{.algorithm = algorithm});
  for (int frame = 0; frame < 6; ++frame) {
    scene.advance();
    boxes = scene.boxes();
    for (std::uint32_t k = 0; k < n; ++k) {
      if (frame < 2 || k % 50 == 0) twins.move(k, boxes[k]);
      if (frame < 4 || k % 7 != 0) continue;
      filters[k].world = frame == 4 ? filters[n - 1 - k].world : k;
      twins.set_filter(k, filters[k]);
    }
    ASSERT_TRUE(twins.agree()) << "frame " << frame;
    if (!device_broad_phase) continue;
    BroadPhase oracle({.algorithm = "oracle"});
    for (std::uint32_t k = 0; k < n; ++k) oracle.add(boxes[k], filters[k]);
    (void)oracle.update();
    const cl::Buffer box_buffer = queue.buffer_of(boxes);
    const cl::Buffer filter_buffer = queue.buffer_of(filters);
    const auto result = device_broad_phase->update(
        {.buffer = box_buffer(), .count = n, .filters = filter_buffer(), .worlds = true});
    EXPECT_EQ(result.pair_count, oracle.pairs().size());
    ASSERT_TRUE(same("on the device", queue.read(device_broad_phase->pairs()), oracle.pairs()));
  }
}

void follow_oracle(const AlgorithmInfo& algorithm, std::uint32_t objects, std::uint32_t in_place,
                   const std::function<std::uint32_t(std::uint32_t)>& world_of) {
  follow_oracle(std::string(algorithm.name), algorithm.on_device, SceneOfWorlds(objects, in_place, world_of));
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallWorldsInBlocks) {
  follow_oracle(GetParam(), 150, 30, [](std::uint32_t k) { return k / 30; });
}

NOT_IN(rusticl | sanitizers, "takes long; smaller ones are in it");
TEST_P(EachAlgorithm, WorldsInBlocks) {
  follow_oracle(GetParam(), 2000, 250, [](std::uint32_t k) { return k / 250; });
}

NOT_IN(rusticl | sanitizers, "takes long; smaller ones are in it");
TEST_P(EachAlgorithm, WorldsInterleaved) {
  follow_oracle(GetParam(), 2000, 40, [](std::uint32_t k) { return k % 50; });
}

NOT_IN(sanitizers, "takes long; smaller ones are in it");
TEST_P(EachAlgorithm, WorldsWithHolesInTheirNumbers) {
  follow_oracle(GetParam(), 1500, 100, [](std::uint32_t k) { return (k % 15) * 0x11111111U; });
}

TEST_P(EachAlgorithm, WorldsOneOfEverything) {
  follow_oracle(GetParam(), 1000, 1000, [](std::uint32_t) { return 77; });
}

TEST_P(EachAlgorithm, WorldsOnePerObject) {
  follow_oracle(GetParam(), 1000, 10, [](std::uint32_t k) { return k; });
}

NOT_IN(rusticl | sanitizers, "takes long; smaller ones are in it");
TEST_P(EachAlgorithm, WorldsOneThatIsMuchLargerThanTheOthers) {
  follow_oracle(GetParam(), 1500, 400, [](std::uint32_t k) { return k < 1000 ? 3 : k; });
}

/// A ground plane and other objects that all worlds share.
ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallWorldsWithObjectsInAllOfThem) {
  follow_oracle(GetParam(), 100, 30,
                [](std::uint32_t k) { return k % 40 == 5 ? Filter::all_worlds : k / 30; });
}

TEST_P(EachAlgorithm, WorldsWithObjectsInAllOfThem) {
  follow_oracle(GetParam(), 1500, 100,
                [](std::uint32_t k) { return k % 100 == 5 ? Filter::all_worlds : k % 15; });
}

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_P(EachAlgorithm, SmallObjectsOfAllWorldsPairWithEachOtherOnce) {
  Twins twins({.algorithm = std::string(GetParam().name)});
  for (const std::uint32_t world : {0U, 1U, Filter::all_worlds, 1U, Filter::all_worlds}) {
    twins.add(unit, {.world = world});
  }
  ASSERT_TRUE(twins.agree());
  EXPECT_EQ(twins.tested().pairs(), (Pairs{{0, 2}, {1, 2}, {1, 3}, {2, 3}, {0, 4}, {1, 4}, {2, 4}, {3, 4}}));
  twins.set_filter(2, {.world = 1});
  ASSERT_TRUE(twins.agree());
  EXPECT_EQ(twins.tested().pairs(), (Pairs{{1, 2}, {1, 3}, {2, 3}, {0, 4}, {1, 4}, {2, 4}, {3, 4}}));
}

}  // namespace
}  // namespace broadcl::test
