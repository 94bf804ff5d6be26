// Rays, sweeps and contact tests of a world, asked for right after objects were moved, without a step
// between, on BroadCL's broad phase and on Bullet's own. What they must find is found by asking each object
// by itself.
#include <btBulletDynamicsCommon.h>

#include <array>
#include <memory>
#include <set>
#include <vector>

#include <gtest/gtest.h>

#include "bullet_contract.hpp"
#include "bullet_rig.hpp"

namespace broadcl {
namespace {

using test::kinds;
using test::Random;

using Objects = std::multiset<const btCollisionObject*>;

/// All that a sweep hits.
struct SweepCollector final : btCollisionWorld::ConvexResultCallback {
  btScalar addSingleResult(btCollisionWorld::LocalConvexResult& result, bool /*is_world*/) override {
    hits.insert(result.m_hitCollisionObject);
    return m_closestHitFraction;
  }
  Objects hits;
};

/// The objects that reach into one.
struct ContactCollector final : btCollisionWorld::ContactResultCallback {
  explicit ContactCollector(const btCollisionObject& object) : asked(object) {}
  btScalar addSingleResult(btManifoldPoint& point, const btCollisionObjectWrapper* s, int /*part*/,
                           int /*index*/, const btCollisionObjectWrapper* t, int /*part*/,
                           int /*index*/) override {
    const btCollisionObject* other = s->getCollisionObject();
    if (other == &asked) other = t->getCollisionObject();
    if (point.getDistance() < 0) objects.insert(other);
    return 1;
  }
  const btCollisionObject& asked;
  std::set<const btCollisionObject*> objects;
};

/// 200 objects of three shapes, anywhere in a cube.
class Scene {
 public:
  explicit Scene(btBroadphaseInterface& broadphase)
      : objects(200), world(&dispatcher_, &broadphase, &configuration_) {
    const std::array<btCollisionShape*, 3> shapes{&box_, &ball_, &capsule_};
    for (std::size_t k = 0; k < objects.size(); ++k) {
      objects[k].setCollisionShape(shapes[k % shapes.size()]);
      objects[k].setWorldTransform(anywhere());
      world.addCollisionObject(&objects[k]);
    }
  }
  ~Scene() {
    for (btCollisionObject& object : objects) world.removeCollisionObject(&object);
  }
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;
  Scene(Scene&&) = delete;
  Scene& operator=(Scene&&) = delete;

  btVector3 any_place() { return random_.point(15); }
  btTransform anywhere() {
    const btVector3 axis = random_.point(2) + btVector3(0.1F, 0, 0);
    const btQuaternion rotation(axis, random_.coordinate(3));
    return btTransform(rotation, any_place());
  }
  btCollisionObject& any_object() { return objects[random_.below(200)]; }
  /// As a user does who wants queries to see it at once.
  void move_some() {
    for (int k = 0; k < 20; ++k) {
      btCollisionObject& object = any_object();
      object.setWorldTransform(anywhere());
      world.updateSingleAabb(&object);
    }
  }
  /// Asks each object by itself.
  void each_ray_test(const btTransform& from, const btTransform& to,
                     btCollisionWorld::RayResultCallback& callback) {
    for (btCollisionObject& object : objects) {
      btCollisionWorld::rayTestSingle(from, to, &object, object.getCollisionShape(),
                                      object.getWorldTransform(), callback);
    }
  }
  /// The same.
  void each_sweep_test(const btConvexShape& shape, const btTransform& from, const btTransform& to,
                       btCollisionWorld::ConvexResultCallback& callback) {
    for (btCollisionObject& object : objects) {
      btCollisionWorld::objectQuerySingle(&shape, from, to, &object, object.getCollisionShape(),
                                          object.getWorldTransform(), callback, 0);
    }
  }

 private:
  Random random_{1};
  btBoxShape box_{{0.5F, 0.7F, 0.9F}};
  btSphereShape ball_{0.8F};
  btCapsuleShape capsule_{0.4F, 1.5F};
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};

 public:
  std::vector<btCollisionObject> objects;
  btCollisionWorld world;
};

Objects hits(const btCollisionWorld::AllHitsRayResultCallback& callback) {
  Objects result;
  for (int k = 0; k < callback.m_collisionObjects.size(); ++k) result.insert(callback.m_collisionObjects[k]);
  return result;
}

class WorldQueries : public test::Contract {
 protected:
  std::unique_ptr<btBroadphaseInterface> broadphase_ = GetParam().make(nullptr);
  Scene scene_{*broadphase_};
};

INSTANTIATE_TEST_SUITE_P(World, WorldQueries, testing::ValuesIn(kinds),
                         [](const auto& test) { return test.param.name; });

TEST_P(WorldQueries, RaysHitAllThatIsOnTheirWay) {
  std::size_t count = 0;
  for (int round = 0; round < 200; ++round) {
    if (round % 10 == 0) scene_.move_some();
    if (round % 50 == 0) scene_.world.performDiscreteCollisionDetection();
    btTransform from = scene_.anywhere();
    btTransform to = scene_.anywhere();
    if (round % 3 == 0) to.getOrigin() = {from.getOrigin().x(), from.getOrigin().y(), to.getOrigin().z()};
    const btVector3& start = from.getOrigin();
    const btVector3& end = to.getOrigin();
    btCollisionWorld::AllHitsRayResultCallback all(start, end);
    btCollisionWorld::AllHitsRayResultCallback expected_all(start, end);
    scene_.world.rayTest(start, end, all);
    scene_.each_ray_test(from, to, expected_all);
    ASSERT_EQ(hits(all), hits(expected_all)) << "round " << round;
    count += hits(all).size();
    btCollisionWorld::ClosestRayResultCallback closest(start, end);
    btCollisionWorld::ClosestRayResultCallback expected_closest(start, end);
    scene_.world.rayTest(start, end, closest);
    scene_.each_ray_test(from, to, expected_closest);
    ASSERT_EQ(closest.m_collisionObject, expected_closest.m_collisionObject) << "round " << round;
    ASSERT_EQ(closest.m_closestHitFraction, expected_closest.m_closestHitFraction) << "round " << round;
  }
  EXPECT_GT(count, 200U);
}

TEST_P(WorldQueries, SweepsHitAllThatIsOnTheirWay) {
  const btBoxShape shape({0.3F, 0.2F, 0.4F});
  std::size_t count = 0;
  for (int round = 0; round < 200; ++round) {
    if (round % 10 == 0) scene_.move_some();
    if (round % 50 == 0) scene_.world.performDiscreteCollisionDetection();
    const btTransform from = scene_.anywhere();
    const btTransform to(from.getBasis(), scene_.any_place());
    SweepCollector all;
    SweepCollector expected_all;
    scene_.world.convexSweepTest(&shape, from, to, all);
    scene_.each_sweep_test(shape, from, to, expected_all);
    ASSERT_EQ(all.hits, expected_all.hits) << "round " << round;
    count += all.hits.size();
    btCollisionWorld::ClosestConvexResultCallback closest(from.getOrigin(), to.getOrigin());
    btCollisionWorld::ClosestConvexResultCallback expected_closest(from.getOrigin(), to.getOrigin());
    scene_.world.convexSweepTest(&shape, from, to, closest);
    scene_.each_sweep_test(shape, from, to, expected_closest);
    // Of several that it reaches into at its start, each is the closest.
    ASSERT_EQ(closest.m_closestHitFraction, expected_closest.m_closestHitFraction) << "round " << round;
  }
  EXPECT_GT(count, 400U);
}

TEST_P(WorldQueries, ContactTestsSeeWhatWasMoved) {
  std::size_t count = 0;
  for (int round = 0; round < 100; ++round) {
    scene_.move_some();
    // The object that is asked for needs no new box: its shape where it is now is asked.
    btCollisionObject& object = scene_.any_object();
    object.setWorldTransform(scene_.anywhere());
    ContactCollector found(object);
    scene_.world.contactTest(&object, found);
    ContactCollector expected(object);
    for (btCollisionObject& other : scene_.objects) {
      if (&other != &object) scene_.world.contactPairTest(&object, &other, expected);
    }
    ASSERT_EQ(found.objects, expected.objects) << "round " << round;
    count += found.objects.size();
    scene_.world.updateSingleAabb(&object);
  }
  EXPECT_GT(count, 50U);
}

}  // namespace
}  // namespace broadcl
