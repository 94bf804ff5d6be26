#include "scenes/box_world.hpp"

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/BroadphaseCollision/btSimpleBroadphase.h>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>
#include <cstddef>
#include <memory>
#include <numeric>
#include <span>
#include <string>
#include <vector>

#include "scenes/broadphases.hpp"
#include "scenes/generators.hpp"

namespace broadcl::scenes {
namespace {

/// 0-1 and 1-2 touch.
const std::vector<Aabb> in_a_row = {
    {{0, 0, 0}, {1, 1, 1}}, {{1, 0, 0}, {2, 1, 1}}, {{2, 0, 0}, {3, 1, 1}}, {{9, 9, 9}, {10, 10, 10}}};
/// 2-3 overlap.
const std::vector<Aabb> moved = {
    {{0, 0, 0}, {1, 1, 1}}, {{5, 0, 0}, {6, 1, 1}}, {{9, 9, 9}, {10, 10, 10}}, {{9, 9, 9}, {10, 10, 10}}};

/// A frame of the same boxes as before, or of new ones.
RecordedFrame frame_of(std::span<const Aabb> boxes, bool are_new = false) {
  RecordedFrame frame;
  frame.boxes.assign(boxes.begin(), boxes.end());
  frame.ids.resize(boxes.size());
  std::iota(frame.ids.begin(), frame.ids.end(), 0U);
  if (are_new) frame.added = frame.ids;
  return frame;
}

class BoxWorldOnBulletBf : public testing::Test {
 protected:
  BoxWorldOnBulletBf() {
    world_.set(frame_of(moved, true));
    world_.step(frame_of(in_a_row));
  }

  btOverlappingPairCache& cache() { return *broadphase_.getOverlappingPairCache(); }

  void expect(const std::vector<Aabb>& boxes, std::size_t missing, std::size_t extra) {
    const Difference difference = world_.verify(boxes);
    EXPECT_EQ(difference.missing, missing);
    EXPECT_EQ(difference.extra, extra);
  }

  btSimpleBroadphase broadphase_;
  BoxWorld world_{broadphase_};
};

TEST_F(BoxWorldOnBulletBf, HasThePairsOfTheLastStep) {
  EXPECT_EQ(cache().getNumOverlappingPairs(), 2);
  expect(in_a_row, 0, 0);
  world_.step(frame_of(moved));
  EXPECT_EQ(cache().getNumOverlappingPairs(), 1);
  expect(moved, 0, 0);
}

TEST_F(BoxWorldOnBulletBf, VerifyTrustsNoBoxOfTheBroadPhase) {
  // As if the move had not been reported to the broad phase: its own boxes and pairs agree.
  expect(moved, 1, 2);
}

TEST_F(BoxWorldOnBulletBf, ProxiesComeAndGoAndChangeTheirFilters) {
  RecordedFrame frame = frame_of(in_a_row);
  frame.gone = {0, 3};
  frame.ids = {0, 1, 2, 5};
  frame.added = {0, 5};
  frame.boxes = {in_a_row[0], in_a_row[1], in_a_row[2], in_a_row[2]};
  frame.filters = {{.id = 1, .value = {.group = 2, .mask = 4}}, {.id = 5, .value = {.group = 4, .mask = 2}}};
  world_.step(frame);
  expect(frame.boxes, 0, 0);
  EXPECT_EQ(cache().getNumOverlappingPairs(), 1);  // of 1 and 5
}

TEST(BoxWorld, RunsOnEveryBroadPhaseAndLeavesItEmpty) {
  MovingBoxes scene(200, MovingBoxes::Sizes::mixed);
  const std::size_t count = scene.boxes().size();
  for (const BroadphaseInfo& info : broadphases()) {
    const auto broadphase =
        make_broadphase({.name = info.name, .device = {}, .objects = count, .world_edge = 200});
    {
      BoxWorld world(*broadphase);
      world.set(frame_of(scene.boxes(), true));
      for (int frame = 0; frame < 5; ++frame) {
        scene.advance();
        world.step(frame_of(scene.boxes()));
        const Difference difference = world.verify(scene.boxes());
        EXPECT_EQ(difference.missing, 0U) << info.name;
        EXPECT_TRUE(difference.extra == 0 || !info.exact) << info.name;
      }
      EXPECT_GT(broadphase->getOverlappingPairCache()->getNumOverlappingPairs(), 0) << info.name;
    }
    EXPECT_EQ(broadphase->getOverlappingPairCache()->getNumOverlappingPairs(), 0) << info.name;
    const auto* own = dynamic_cast<const BulletBroadphase*>(broadphase.get());
    EXPECT_TRUE(own == nullptr || own->broad_phase().size() == 0) << info.name;
  }
}

}  // namespace
}  // namespace broadcl::scenes
