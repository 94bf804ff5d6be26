#include <BulletCollision/CollisionDispatch/btGhostObject.h>

#include <algorithm>
#include <cstddef>
#include <functional>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/bullet.hpp>

#include "bullet_scenes.hpp"
#include "runs.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/verify.hpp"
#include "shadow_broadphase.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

SUITE_NOT_IN(EachScene, sanitizers, "takes long, above all in Bullet");

class EachScene : public testing::TestWithParam<BulletSceneInfo> {
 protected:
  /// Every broad phase of the table, in its order.
  static std::vector<std::unique_ptr<btBroadphaseInterface>> all_broadphases() {
    std::vector<std::unique_ptr<btBroadphaseInterface>> result;
    for (const scenes::BroadphaseInfo& info : scenes::broadphases()) {
      result.push_back(
          scenes::make_broadphase({.name = info.name, .device = {}, .objects = 2000, .world_edge = 400}));
    }
    return result;
  }
};

/// How many of `pairs` are not among `known`; both are sorted.
std::size_t count_of_new(const std::vector<ClientPair>& pairs, const std::vector<ClientPair>& known) {
  std::vector<ClientPair> rest;
  std::set_difference(pairs.begin(), pairs.end(), known.begin(), known.end(), std::back_inserter(rest));
  return rest.size();
}

/// How many ghosts list other objects than the pair cache does.
std::size_t count_of_wrong_ghosts(btCollisionWorld& world) {
  std::size_t wrong = 0;
  btBroadphaseInterface& broadphase = *world.getBroadphase();
  const std::vector<ClientPair> pairs = client_pairs(broadphase);
  const btCollisionObjectArray& objects = world.getCollisionObjectArray();
  for (int k = 0; k < objects.size(); ++k) {
    btGhostObject* ghost = btGhostObject::upcast(objects[k]);
    if (ghost == nullptr) continue;
    std::vector<const void*> expected;
    for (const auto& [s, t] : pairs) {
      if (s == ghost) expected.push_back(t);
      if (t == ghost) expected.push_back(s);
    }
    const btAlignedObjectArray<btCollisionObject*>& overlapping = ghost->getOverlappingPairs();
    std::vector<const void*> reported;
    reported.reserve(expected.size());
    for (int j = 0; j < overlapping.size(); ++j) reported.push_back(overlapping[j]);
    std::sort(expected.begin(), expected.end(), std::less<>());
    std::sort(reported.begin(), reported.end(), std::less<>());
    if (reported != expected) ++wrong;
  }
  return wrong;
}

TEST_P(EachScene, HasTheSamePairsWithEveryBroadPhaseInEveryFrame) {
  BulletBroadphase in_world;
  const std::vector<scenes::BroadphaseInfo> infos = scenes::broadphases();
  const auto others = all_broadphases();
  std::vector<btBroadphaseInterface*> shadows;
  shadows.reserve(others.size());
  for (const auto& other : others) shadows.push_back(other.get());
  ShadowBroadphase all(in_world, shadows);
  const auto scene = GetParam().make(all);
  std::vector<ClientPair> before;
  std::size_t came = 0;
  std::size_t went = 0;
  for (int frame = 0; frame < GetParam().frames; ++frame) {
    scene->step();
    const scenes::Difference difference = scenes::verify(scene->bullet());
    ASSERT_EQ(difference.missing, 0U) << "frame " << frame;
    ASSERT_EQ(difference.extra, 0U) << "frame " << frame;
    ASSERT_EQ(count_of_wrong_ghosts(scene->bullet()), 0U) << "frame " << frame;
    const std::vector<ClientPair> pairs = client_pairs(in_world);
    for (std::size_t k = 0; k < shadows.size(); ++k) {
      const std::vector<ClientPair> others_pairs = client_pairs(*shadows[k]);
      if (infos[k].exact) {
        ASSERT_EQ(others_pairs, pairs) << infos[k].name << ", frame " << frame;
      } else {
        ASSERT_TRUE(std::includes(others_pairs.begin(), others_pairs.end(), pairs.begin(), pairs.end()))
            << infos[k].name << " lacks a pair, frame " << frame;
      }
    }
    came += count_of_new(pairs, before);
    went += count_of_new(before, pairs);
    before = pairs;
  }
  EXPECT_GT(came, 100U);
  EXPECT_GT(went, 10U);
}

INSTANTIATE_TEST_SUITE_P(World, EachScene, testing::ValuesIn(bullet_scenes()), named_by_parameter);

std::vector<BulletSceneInfo> long_scenes() {
  std::vector<BulletSceneInfo> rows = bullet_scenes();
  for (BulletSceneInfo& row : rows) row.frames *= 10;
  return rows;
}

INSTANTIATE_TEST_SUITE_P(Long, EachScene, testing::ValuesIn(long_scenes()), named_by_parameter);

}  // namespace
}  // namespace broadcl::test
