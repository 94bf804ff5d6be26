#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "device_twins.hpp"
#include "each_algorithm.hpp"
#include "scenes/generators.hpp"
#include "test_name.hpp"
#include "twins.hpp"

/// Worlds, sets and other filters of objects in motion.
namespace broadcl::test {
namespace {

/// Objects and their filters.
struct FilterScene {
  const char* name;
  std::uint32_t objects;
  std::uint32_t crowd;  ///< It is as crowded as this many objects without filters would be.
  Filter (*filter)(std::uint32_t k);
};

constexpr Filter world_of_blocks(std::uint32_t k, std::uint32_t size) {
  return {.world = k / size};
}

constexpr Filter set_in(std::uint32_t k, std::uint32_t worlds) {
  Filter filter = k % 3 == 0 ? Filter::first_set : Filter::second_set;
  filter.world = k % 10 == 9 && worlds > 1 ? Filter::all_worlds : k / 10 % worlds;
  return filter;
}

constexpr Filter group_and_body(std::uint32_t k) {
  return {.group = 1U << (k % 3), .mask = k % 5 == 0 ? 3U : 7U, .body = k / 4};
}

constexpr std::array small_scenes{
    FilterScene{"worlds in blocks", 150, 30, [](std::uint32_t k) { return world_of_blocks(k, 30); }},
    FilterScene{"objects in all worlds", 100, 30,
                [](std::uint32_t k) {
                  return k % 40 == 5 ? Filter{.world = Filter::all_worlds} : world_of_blocks(k, 30);
                }},
    FilterScene{"two sets", 90, 90, [](std::uint32_t k) { return set_in(k, 1); }},
    FilterScene{"groups and bodies", 90, 90, group_and_body},
};
constexpr std::array scenes_of_filters{
    FilterScene{"one world", 1000, 1000, [](std::uint32_t /*k*/) { return Filter{.world = 77}; }},
    FilterScene{"a world per object", 1000, 10, [](std::uint32_t k) { return Filter{.world = k}; }},
    FilterScene{"objects in all worlds", 1500, 100,
                [](std::uint32_t k) { return Filter{.world = k % 100 == 5 ? Filter::all_worlds : k % 15}; }},
    FilterScene{"two sets in each of many worlds", 1000, 1000, [](std::uint32_t k) { return set_in(k, 17); }},
    FilterScene{"groups and bodies", 1000, 1000, group_and_body},
};
constexpr std::array large_scenes{
    FilterScene{"worlds in blocks", 2000, 250, [](std::uint32_t k) { return world_of_blocks(k, 250); }},
    FilterScene{"interleaved worlds", 2000, 40, [](std::uint32_t k) { return Filter{.world = k % 50}; }},
    FilterScene{"worlds with holes in their numbers", 1500, 100,
                [](std::uint32_t k) { return Filter{.world = (k % 15) * 0x11111111U}; }},
    FilterScene{"one world that is much larger than the others", 1500, 400,
                [](std::uint32_t k) { return Filter{.world = k < 1000 ? 3 : k}; }},
    FilterScene{"two sets", 1500, 1500, [](std::uint32_t k) { return set_in(k, 1); }},
};

/// The boxes of a scene, which move.
class CrowdInMotion {
 public:
  explicit CrowdInMotion(const FilterScene& scene)
      : motion_(scene.objects, scenes::MovingBoxes::Sizes::mixed),
        scale_(scenes::MovingBoxes(scene.crowd, scenes::MovingBoxes::Sizes::mixed).edge() / motion_.edge()) {}

  [[nodiscard]] std::vector<Aabb> advance() {
    motion_.advance();
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

 private:
  scenes::MovingBoxes motion_;
  float scale_;
};

/// All objects move, then a few; some get the filters of others; some come and go, at last one that may pair
/// with all others. On the device from boxes in its memory, too.
void follow(const AlgorithmInfo& algorithm, const FilterScene& scene) {
  SCOPED_TRACE(scene.name);
  const std::string name(algorithm.name);
  const CallersQueue queue;
  std::optional<DeviceTwins<>> on_device;
  if (algorithm.on_device && name != "gpu-bf")
    on_device.emplace(queue, DeviceBroadPhase::Config{.algorithm = name});
  CrowdInMotion crowd(scene);
  const std::uint32_t n = scene.objects;
  DeviceFrame now{.boxes = crowd.advance(), .worlds = true};
  for (std::uint32_t k = 0; k < n; ++k) now.filters.push_back(scene.filter(k));
  Twins twins(Config{.algorithm = name});
  for (std::uint32_t k = 0; k < n; ++k) twins.add(now.boxes[k], now.filters[k]);
  for (std::uint32_t frame = 0; frame < 10; ++frame) {
    const std::vector<Aabb> next = crowd.advance();
    for (std::uint32_t k = 0; k < n; ++k) {
      if (frame < 2 || k % 50 == frame) twins.move(k, now.boxes[k] = next[k]);
      if ((frame != 4 && frame != 5) || k % 7 != 0) continue;
      now.filters[k] = frame == 4 ? now.filters[n - 1 - k] : scene.filter(k);
      if (frame == 5) now.filters[k].world = k;
      twins.set_filter(k, now.filters[k]);
    }
    if (frame == 6) {
      twins.remove(3);
      twins.remove(n - 15);
    }
    if (frame == 7) {
      EXPECT_EQ(twins.add(now.boxes[3]), 3U);
    }
    if (frame == 8) twins.set_filter(3, now.filters[3]);
    if (frame == 9) twins.set_filter(7, {.group = 8, .mask = 0});
    ASSERT_TRUE(twins.agree()) << "frame " << frame;
    if (on_device && frame < 6) {
      ASSERT_TRUE(on_device->update(now)) << "on the device, frame " << frame;
    }
  }
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallScenesOfFilters) {
  for (const FilterScene& scene : small_scenes) follow(GetParam(), scene);
}

NOT_IN(sanitizers, "takes long; smaller ones are in it");
TEST_P(EachAlgorithm, ScenesOfFilters) {
  for (const FilterScene& scene : scenes_of_filters) follow(GetParam(), scene);
}

class LongScenes : public ::testing::TestWithParam<AlgorithmInfo> {};
INSTANTIATE_TEST_SUITE_P(Long, LongScenes, ::testing::ValuesIn(algorithms().begin(), algorithms().end()),
                         named_by_parameter);

TEST_P(LongScenes, OfFilters) {
  for (const FilterScene& scene : large_scenes) follow(GetParam(), scene);
}

}  // namespace
}  // namespace broadcl::test
