#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include "callers_queue.hpp"
#include "each_algorithm.hpp"
#include "failing_opencl.hpp"
#include "scenes/generators.hpp"

/// begin() leaves the thread free: none of its OpenCL calls waits.
namespace broadcl::test {
namespace {

using scenes::MovingBoxes;

/// What changes between two updates.
struct Step {
  const char* what;
  void (*change)(BroadPhase& broad_phase, MovingBoxes& scene);
};

void map(BroadPhase& broad_phase, MovingBoxes& scene, std::size_t n) {
  scene.advance();
  std::ranges::copy(scene.boxes().first(n), broad_phase.map(n).begin());
}

void move(BroadPhase& broad_phase, MovingBoxes& scene, std::uint32_t first, std::uint32_t end) {
  scene.advance();
  for (std::uint32_t id = first; id < end; ++id) broad_phase.move(id, scene.boxes()[id]);
}

constexpr std::array steps{
    // NOLINT(modernize-avoid-c-arrays)
    Step{"the first boxes", [](BroadPhase& b, MovingBoxes& s) { map(b, s, 500); }},
    Step{"all move", [](BroadPhase& b, MovingBoxes& s) { map(b, s, 500); }},
    Step{"all move, one by one", [](BroadPhase& b, MovingBoxes& s) { move(b, s, 0, 500); }},
    Step{"some move", [](BroadPhase& b, MovingBoxes& s) { move(b, s, 30, 50); }},
    Step{"others move", [](BroadPhase& b, MovingBoxes& s) { move(b, s, 40, 90); }},
    Step{"one has a filter", [](BroadPhase& b, MovingBoxes& /*s*/) { b.set_filter(3, {.mask = 0}); }},
    Step{"many have filters",
         [](BroadPhase& b, MovingBoxes& s) {
           for (std::uint32_t id = 0; id < 400; ++id) b.set_filter(id, {.body = id / 4});
           move(b, s, 0, 400);
         }},
    Step{"worlds", [](BroadPhase& b, MovingBoxes& /*s*/) { b.set_filter(7, {.world = 1}); }},
    Step{"some go",
         [](BroadPhase& b, MovingBoxes& /*s*/) {
           for (const std::uint32_t id : {1U, 70U, 499U}) b.remove(id);
         }},
    Step{"some come",
         [](BroadPhase& b, MovingBoxes& /*s*/) {
           for (int k = 0; k < 20; ++k) b.add(unit, {.group = 3});
         }},
    Step{"many more", [](BroadPhase& b, MovingBoxes& s) { map(b, s, 2000); }},
    Step{"many more move", [](BroadPhase& b, MovingBoxes& s) { map(b, s, 2000); }},
    Step{"all are at one place",
         [](BroadPhase& b, MovingBoxes& /*s*/) {
           for (Aabb& box : b.map(300)) box = unit;
         }},
    Step{"after the lists have grown", [](BroadPhase& b, MovingBoxes& s) { move(b, s, 0, 300); }},
    Step{"nothing", [](BroadPhase& /*b*/, MovingBoxes& /*s*/) {}},
};

TEST_P(EachDeviceAlgorithm, BeginDoesNotBlock) {
  BroadPhase broad_phase(config());
  MovingBoxes scene(2000, MovingBoxes::Sizes::mixed);
  const long start = opencl_use().blocking_calls;
  for (const Step& step : steps) {
    step.change(broad_phase, scene);
    const long before = opencl_use().blocking_calls;
    broad_phase.begin();
    EXPECT_EQ(opencl_use().blocking_calls, before) << step.what;
    (void)broad_phase.finish();
  }
  if (broad_phase.device() == nullptr) return;  // `auto`, which may work on the host
  EXPECT_GT(opencl_use().blocking_calls, start + 5) << "blocking calls are not counted";
}

TEST(Blocking, BeginOnTheCallersQueueDoesNot) {
  const CallersQueue queue;
  const MovingBoxes scene(2000, MovingBoxes::Sizes::mixed);
  const cl::Buffer boxes = queue.buffer_of(std::vector<Aabb>(scene.boxes().begin(), scene.boxes().end()));
  const cl::Buffer same_boxes = queue.buffer_of(std::vector<Aabb>(300, unit));
  const cl::Buffer filters = queue.buffer_of(std::vector<Filter>(2000, Filter{.group = 2, .mask = 2}));
  const std::vector<DeviceBroadPhase::Boxes> updates{
      {.buffer = boxes(), .count = 500},
      {.buffer = boxes(), .count = 500, .offset = 24},
      {.buffer = boxes(), .count = 400, .filters = filters()},
      {.buffer = boxes(), .count = 400, .filters = filters(), .worlds = true},
      {.buffer = boxes(), .count = 2000},
      {.buffer = boxes(), .count = 0},
      {.buffer = same_boxes(), .count = 300},
      {.buffer = boxes(), .count = 1000, .stride = 48},
  };
  for (const std::string algorithm : {"auto", "brute-force", "tiles"}) {
    DeviceBroadPhase broad_phase(queue(), {.algorithm = algorithm});
    const long start = opencl_use().blocking_calls;
    for (const DeviceBroadPhase::Boxes& update : updates) {
      const long before = opencl_use().blocking_calls;
      broad_phase.begin(update);
      EXPECT_EQ(opencl_use().blocking_calls, before) << algorithm << ", update " << &update - updates.data();
      broad_phase.finish();
    }
    EXPECT_GT(opencl_use().blocking_calls, start + 5) << "blocking calls are not counted";
  }
}

}  // namespace
}  // namespace broadcl::test
