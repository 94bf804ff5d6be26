#include "scenes/world.hpp"

#include <BulletCollision/BroadphaseCollision/btAxisSweep3.h>
#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <BulletCollision/BroadphaseCollision/btSimpleBroadphase.h>
#include <BulletCollision/CollisionShapes/btCollisionShape.h>
#include <BulletDynamics/Dynamics/btDiscreteDynamicsWorld.h>
#include <BulletDynamics/Dynamics/btRigidBody.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "each_scenario.hpp"
#include "expect_error.hpp"
#include "runs.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/verify.hpp"
#include "test_name.hpp"

namespace broadcl::scenes {
namespace {

btRigidBody& body(World& world, std::size_t collision_object) {
  return *btRigidBody::upcast(world.bullet().getCollisionObjectArray()[static_cast<int>(collision_object)]);
}

btRigidBody& object(World& world, std::size_t k) {
  return body(world, World::walls + k);
}

std::vector<Eigen::Vector3f> positions(const World& world) {
  std::vector<Eigen::Vector3f> result;
  for (std::size_t k = 0; k < world.scenario().objects().size(); ++k) result.push_back(world.position(k));
  return result;
}

/// How far outside the container the centre of the farthest object is.
float farthest_out(const World& world) {
  float farthest = 0;
  for (const Eigen::Vector3f& p : positions(world)) farthest = std::max(farthest, p.cwiseAbs().maxCoeff());
  return std::max(0.0F, farthest - world.scenario().container_edge() / 2);
}

class EachScenarioWorld : public testing::TestWithParam<std::string> {};

// At 50 g objects sink into the walls; one past the middle of a wall would be pushed out on the far side.
NOT_IN(sanitizers, "takes long");
TEST_P(EachScenarioWorld, LosesNoObject) {
  btDbvtBroadphase tree;
  World world({.name = GetParam(), .objects = 100}, tree);
  const float allowed = world.scenario().gravity_rotates() ? 10.0F : 0.0F;
  for (int frame = 0; frame < 2048; ++frame) {
    world.step();
    ASSERT_LE(farthest_out(world), allowed) << "frame " << frame;
  }
}

INSTANTIATE_TEST_SUITE_P(World, EachScenarioWorld, testing::ValuesIn(test::scenario_names()),
                         test::named_by_parameter);

TEST(World, ComesToRestOnTheFloorInFreeFall) {
  btDbvtBroadphase tree;
  World world({.name = "free-fall", .objects = 100}, tree);
  for (int frame = 0; frame < 2048; ++frame) world.step();
  const float floor = -world.scenario().container_edge() / 2;
  for (std::size_t k = 0; k < 100; ++k) {
    EXPECT_LT(object(world, k).getLinearVelocity().length(), 0.1F);
    EXPECT_GT(world.position(k).y(), floor + 0.4F);
    EXPECT_LT(world.position(k).y(), floor + 4);
  }
}

TEST(World, FallsAsGravitySays) {
  btDbvtBroadphase tree;
  World world({.name = "free-fall", .objects = 1}, tree);
  const Scenario::Object start = world.scenario().objects()[0];
  world.step();
  const float dt = Scenario::frame_seconds;
  const Eigen::Vector3f velocity = start.velocity + Eigen::Vector3f(0, -9.798F * dt, 0);
  EXPECT_TRUE(world.position(0).isApprox(start.position + velocity * dt, 1e-5F));
}

TEST(World, GivesAKickedObjectItsVelocity) {
  btDbvtBroadphase tree;
  World world({.name = "agitated", .objects = 1}, tree);
  const Eigen::Vector3f start = world.position(0);
  const float dt = Scenario::frame_seconds;
  const Eigen::Vector3f velocity = world.scenario().kicks()[0].velocity + Eigen::Vector3f(0, -9.798F * dt, 0);
  world.step();
  EXPECT_TRUE(world.position(0).isApprox(start + velocity * dt, 1e-5F));
}

class EachShape : public testing::TestWithParam<bool> {};

TEST_P(EachShape, HasTheSizeAndTheMassOfItsObject) {
  btDbvtBroadphase tree;
  World world({.name = "mixed-sizes", .objects = 100, .seed = 1, .spheres = GetParam()}, tree);
  for (std::size_t k = 0; k < 100; ++k) {
    const float edge = world.scenario().objects()[k].edge;
    btVector3 lower;
    btVector3 upper;
    object(world, k).getCollisionShape()->getAabb(btTransform::getIdentity(), lower, upper);
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_FLOAT_EQ(lower[axis], -edge / 2);
      EXPECT_FLOAT_EQ(upper[axis], edge / 2);
    }
    const float volume = edge * edge * edge * (GetParam() ? std::numbers::pi_v<float> / 6 : 1);
    EXPECT_FLOAT_EQ(1 / object(world, k).getInvMass(), volume);
    EXPECT_EQ(object(world, k).getRestitution(), 0);
  }
}

INSTANTIATE_TEST_SUITE_P(World, EachShape, testing::Bool(),
                         [](const auto& test) { return test.param ? "sphere" : "cube"; });

TEST(World, HasWallsWithoutGaps) {
  btDbvtBroadphase tree;
  World world({.name = "free-fall", .objects = 100}, tree);
  const float inner = world.scenario().container_edge() / 2;
  const float outer = World::outer_edge(world.scenario()) / 2;
  EXPECT_FLOAT_EQ(outer, inner + 20);
  std::vector<Eigen::AlignedBox3f> walls;
  for (std::size_t wall = 0; wall < World::walls; ++wall) {
    EXPECT_TRUE(body(world, wall).isStaticObject());
    btVector3 lower;
    btVector3 upper;
    body(world, wall).getAabb(lower, upper);
    walls.emplace_back(Eigen::Vector3f(lower.x(), lower.y(), lower.z()),
                       Eigen::Vector3f(upper.x(), upper.y(), upper.z()));
  }
  Random random(1);
  for (int k = 0; k < 10'000; ++k) {
    const Eigen::Vector3f point = random.vector(-outer, outer);
    const bool in_wall =
        std::any_of(walls.begin(), walls.end(), [&](const auto& wall) { return wall.contains(point); });
    ASSERT_EQ(in_wall, point.cwiseAbs().maxCoeff() >= inner) << point;
  }
}

TEST(World, HasThickerWallsAroundALargeContainer) {
  const Scenario scenario({.name = "mixed-sizes", .objects = 100'000});
  EXPECT_FLOAT_EQ(World::outer_edge(scenario), 1.5F * scenario.container_edge());
}

TEST(World, WakesAllIfGravityRotates) {
  btDbvtBroadphase tree;
  World world({.name = "rolling-gravity", .objects = 20}, tree);
  world.step();
  for (std::size_t k = 0; k < 20; ++k) object(world, k).setActivationState(ISLAND_SLEEPING);
  const Eigen::Vector3f gravity = world.scenario().gravity();
  world.step();
  for (std::size_t k = 0; k < 20; ++k) {
    EXPECT_TRUE(object(world, k).isActive());
    const btVector3& own = object(world, k).getGravity();
    EXPECT_TRUE(Eigen::Vector3f(own.x(), own.y(), own.z()).isApprox(gravity, 1e-6F));
  }
}

TEST(World, WakesWhatItKicks) {
  btDbvtBroadphase tree;
  World world({.name = "agitated", .objects = 100}, tree);
  for (std::size_t k = 0; k < 100; ++k) object(world, k).setActivationState(ISLAND_SLEEPING);
  const std::vector<Scenario::Kick> kicks(world.scenario().kicks().begin(), world.scenario().kicks().end());
  std::vector<Eigen::Vector3f> before = positions(world);
  world.step();
  ASSERT_EQ(kicks.size(), 25U);
  for (const Scenario::Kick& kick : kicks) {
    EXPECT_TRUE(object(world, kick.object).isActive());
    EXPECT_NE(world.position(kick.object), before[kick.object]);
  }
}

/// The objects that an object touches, including itself.
std::vector<const btCollisionObject*> touching(World& world, const btCollisionObject& object) {
  std::vector<const btCollisionObject*> result;
  btDispatcher& dispatcher = *world.bullet().getDispatcher();
  for (int k = 0; k < dispatcher.getNumManifolds(); ++k) {
    const btPersistentManifold& manifold = *dispatcher.getManifoldByIndexInternal(k);
    const bool has_it = manifold.getBody0() == &object || manifold.getBody1() == &object;
    if (!has_it || manifold.getNumContacts() == 0) continue;
    result.push_back(manifold.getBody0());
    result.push_back(manifold.getBody1());
  }
  return result;
}

/// An object leaves the world and enters it again at another position; objects that rested on it must wake.
TEST(World, ExchangesObjectsThatStream) {
  constexpr std::uint32_t objects = 200;
  BulletBroadphase broadphase;
  World world({.name = "streaming", .objects = objects}, broadphase);
  std::vector<btRigidBody*> bodies;
  for (std::size_t k = 0; k < objects; ++k) bodies.push_back(&object(world, k));
  std::size_t exchanged = 0;
  std::size_t woken = 0;
  for (int frame = 0; frame < 600; ++frame) {
    const std::vector<Scenario::Exchange> exchanges(world.scenario().exchanges().begin(),
                                                    world.scenario().exchanges().end());
    std::vector<const btCollisionObject*> neighbours;
    for (const Scenario::Exchange& exchange : exchanges) {
      for (const btCollisionObject* body : touching(world, *bodies[exchange.object])) {
        if (!body->isStaticObject()) neighbours.push_back(body);
      }
    }
    if (!exchanges.empty()) {
      for (btRigidBody* body : bodies) body->setActivationState(ISLAND_SLEEPING);
    }
    world.step();
    for (const Scenario::Exchange& exchange : exchanges) {
      EXPECT_LT((world.position(exchange.object) - exchange.position).norm(), 1.0F) << "frame " << frame;
      EXPECT_TRUE(bodies[exchange.object]->isActive());
    }
    for (const btCollisionObject* body : neighbours) EXPECT_TRUE(body->isActive()) << "frame " << frame;
    exchanged += exchanges.size();
    woken += neighbours.size();
    ASSERT_EQ(broadphase.broad_phase().size(), objects + World::walls);
  }
  EXPECT_NEAR(static_cast<double>(exchanged), 0.05 * 20 * objects, 2);
  EXPECT_GT(woken, 100U);
}

TEST(World, KnowsTheBoxesOfItsBroadPhase) {
  btDbvtBroadphase tree;
  World world({.name = "free-fall", .objects = 10}, tree);
  const Eigen::Vector3f start = world.position(3);
  world.step();
  btVector3 lower;
  btVector3 upper;
  tree.getAabb(object(world, 3).getBroadphaseHandle(), lower, upper);
  EXPECT_EQ(world.box(3).min(), Eigen::Vector3f(lower.x(), lower.y(), lower.z()));
  EXPECT_EQ(world.box(3).max(), Eigen::Vector3f(upper.x(), upper.y(), upper.z()));
  EXPECT_TRUE(world.box(3).contains(start));
}

TEST(World, LeavesItsBroadPhaseEmpty) {
  BulletBroadphase broadphase;
  {
    World world({.name = "mixed-sizes", .objects = 50}, broadphase);
    for (int frame = 0; frame < 20; ++frame) world.step();
    EXPECT_EQ(broadphase.broad_phase().size(), 50 + World::walls);
    EXPECT_GT(world.pair_count(), 0U);
  }
  EXPECT_EQ(broadphase.broad_phase().size(), 0U);
  EXPECT_EQ(broadphase.getOverlappingPairCache()->getNumOverlappingPairs(), 0);
}

class Verify : public testing::Test {
 protected:
  Verify() { world_.step(); }

  btOverlappingPairCache& cache() { return *broadphase_.getOverlappingPairCache(); }

  btBroadphaseProxy* proxy(std::size_t k) { return object(world_, k).getBroadphaseHandle(); }

  void expect(std::size_t missing, std::size_t extra) {
    const Difference difference = verify(world_.bullet());
    EXPECT_EQ(difference.missing, missing);
    EXPECT_EQ(difference.extra, extra);
  }

  btSimpleBroadphase broadphase_;
  World world_{{.name = "free-fall", .objects = 100}, broadphase_};
};

TEST_F(Verify, FindsNothingWrongIfNothingIs) {
  EXPECT_GT(cache().getNumOverlappingPairs(), 0);
  expect(0, 0);
}

TEST_F(Verify, DetectsAMissingPair) {
  const btBroadphasePair& pair = cache().getOverlappingPairArray()[0];
  cache().removeOverlappingPair(pair.m_pProxy0, pair.m_pProxy1, world_.bullet().getDispatcher());
  expect(1, 0);
}

TEST_F(Verify, DetectsABogusPair) {
  std::size_t other = 1;
  while (world_.box(0).intersects(world_.box(other))) ++other;
  cache().addOverlappingPair(proxy(0), proxy(other));
  expect(0, 1);
}

TEST_F(Verify, DetectsAPairThatTheFiltersRefuse) {
  const btBroadphasePair& pair = cache().getOverlappingPairArray()[0];
  pair.m_pProxy0->m_collisionFilterMask = 0;
  EXPECT_GE(verify(world_.bullet()).extra, 1U);
  EXPECT_EQ(verify(world_.bullet()).missing, 0U);
}

TEST_F(Verify, DetectsAPairWithAProxyOfNobody) {
  btBroadphaseProxy* stranger =
      broadphase_.createProxy(proxy(0)->m_aabbMin, proxy(0)->m_aabbMax, 0, nullptr,
                              btBroadphaseProxy::DefaultFilter, btBroadphaseProxy::AllFilter, nullptr);
  cache().addOverlappingPair(proxy(0), stranger);
  expect(0, 1);
  broadphase_.destroyProxy(stranger, world_.bullet().getDispatcher());
}

TEST_F(Verify, TakesABoxWithNanForEmpty) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  cache().removeOverlappingPairsContainingProxy(proxy(0), world_.bullet().getDispatcher());
  proxy(0)->m_aabbMin.setX(nan);
  expect(0, 0);
}

TEST(Broadphases, AreThoseOfBulletThenAllAlgorithms) {
  std::vector<std::string> names;
  for (const BroadphaseInfo& info : broadphases()) {
    names.push_back(info.name);
    EXPECT_FALSE(info.summary.empty());
    EXPECT_EQ(info.bullet, info.name.starts_with("bullet-"));
    EXPECT_EQ(info.exact, info.name != "bullet-sap" && info.name != "bullet-bvh");
  }
  std::vector<std::string> expected{"bullet-bf", "bullet-sap", "bullet-bvh"};
  for (const AlgorithmInfo& info : algorithms()) expected.emplace_back(info.name);
  EXPECT_EQ(names, expected);
}

TEST(Broadphases, RefuseAnUnknownName) {
  EXPECT_THAT(
      test::error_of([] {
        static_cast<void>(make_broadphase({.name = "bvh", .device = {}, .objects = 1, .world_edge = 1}));
      }),
      testing::AllOf(testing::HasSubstr("'bvh'"), testing::HasSubstr("bullet-bf, bullet-sap, bullet-bvh, ")));
}

TEST(Broadphases, OfBroadCLHaveCulling) {
  EXPECT_FALSE(find_broadphase("tiles").culls);
  const BroadphaseInfo info = find_broadphase("tiles+culling");
  EXPECT_EQ(info.name, "tiles+culling");
  EXPECT_TRUE(info.culls && info.on_device && info.exact);
  EXPECT_THAT(test::error_of([] { static_cast<void>(find_broadphase("bullet-bvh+culling")); }),
              testing::HasSubstr("'bullet-bvh+culling'"));
  const auto made = make_broadphase({.name = "oracle+culling", .device = {}, .objects = 1, .world_edge = 1});
  EXPECT_EQ(dynamic_cast<const BulletBroadphase&>(*made).broad_phase().algorithm().name, "oracle");
}

TEST(Broadphases, PassOnDeviceAndAlgorithm) {
  EXPECT_THAT(test::error_of([] {
                static_cast<void>(make_broadphase(
                    {.name = "gpu-bf", .device = "no such device", .objects = 1, .world_edge = 1}));
              }),
              testing::HasSubstr("no such device"));
  for (const AlgorithmInfo& info : algorithms()) {
    const auto made =
        make_broadphase({.name = std::string(info.name), .device = {}, .objects = 1, .world_edge = 1});
    const auto* own = dynamic_cast<const BulletBroadphase*>(made.get());
    ASSERT_NE(own, nullptr);
    EXPECT_EQ(own->broad_phase().algorithm().name, info.name);
  }
}

TEST(Broadphases, HoldTheNumberOfObjectsAskedFor) {
  for (const BroadphaseInfo& info : broadphases()) {
    const auto made = make_broadphase({.name = info.name, .device = {}, .objects = 100, .world_edge = 100});
    std::set<btBroadphaseProxy*> proxies;
    for (int k = 0; k < 100; ++k) {
      proxies.insert(made->createProxy({-1, -1, -1}, {1, 1, 1}, 0, made.get(), 1, 1, nullptr));
    }
    EXPECT_EQ(proxies.size(), 100U) << info.name;
    EXPECT_FALSE(proxies.contains(nullptr)) << info.name;
    made->calculateOverlappingPairs(nullptr);
    EXPECT_EQ(made->getOverlappingPairCache()->getNumOverlappingPairs(), 100 * 99 / 2) << info.name;
    for (btBroadphaseProxy* proxy : proxies) made->destroyProxy(proxy, nullptr);
  }
}

TEST(Broadphases, SweepWithWiderHandlesForManyObjects) {
  const auto sweep = [](std::size_t objects) {
    return make_broadphase({.name = "bullet-sap", .device = {}, .objects = objects, .world_edge = 100});
  };
  EXPECT_NE(dynamic_cast<btAxisSweep3*>(sweep(16'384).get()), nullptr);
  EXPECT_NE(dynamic_cast<bt32BitAxisSweep3*>(sweep(16'385).get()), nullptr);
}

}  // namespace
}  // namespace broadcl::scenes
