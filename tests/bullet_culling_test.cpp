// A world with BulletBroadphase::set_shape_culling() beside one without it: the same objects in both, moved
// in the same way. Contacts must be the same to the last bit, with fewer pairs dispatched.
#include <BulletCollision/CollisionDispatch/btCollisionDispatcherMt.h>
#include <LinearMath/btThreads.h>
#include <btBulletCollisionCommon.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/bullet.hpp>

#include "bullet_rig.hpp"
#include "bullet_shapes.hpp"
#include "expect_error.hpp"

namespace broadcl {
namespace {

using test::at;
using test::error_of;
using test::Random;
using test::Shapes;
using testing::HasSubstr;

/// For the user indices of two objects, the numbers that describe each of their contacts.
using Contacts = std::map<std::pair<int, int>, std::vector<std::array<btScalar, 10>>>;

/// A world in which nothing moves by itself.
class World {
 public:
  explicit World(bool culls) {
    world.getDispatchInfo().m_dispatchFunc = btDispatcherInfo::DISPATCH_DISCRETE;
    dispatcher.setNearCallback(count);
    if (culls) broadphase.set_shape_culling(&world);
  }
  ~World() {
    for (const auto& object : objects) {
      if (object->getBroadphaseHandle() != nullptr) world.removeCollisionObject(object.get());
    }
  }
  World(const World&) = delete;
  World& operator=(const World&) = delete;
  World(World&&) = delete;
  World& operator=(World&&) = delete;

  btCollisionObject& add(btCollisionShape& shape, const btTransform& transform) {
    objects.push_back(std::make_unique<btCollisionObject>());
    btCollisionObject& object = *objects.back();
    object.setCollisionFlags(0);
    object.setUserIndex(static_cast<int>(objects.size() - 1));
    object.setCollisionShape(&shape);
    object.setWorldTransform(transform);
    world.addCollisionObject(&object);
    return object;
  }
  void collide() {
    dispatched = 0;
    world.performDiscreteCollisionDetection();
  }
  [[nodiscard]] Contacts contacts() {
    Contacts result;
    for (int k = 0; k < dispatcher.getNumManifolds(); ++k) {
      const btPersistentManifold& manifold = *dispatcher.getManifoldByIndexInternal(k);
      if (manifold.getNumContacts() == 0) continue;
      auto& points = result[{manifold.getBody0()->getUserIndex(), manifold.getBody1()->getUserIndex()}];
      for (int p = 0; p < manifold.getNumContacts(); ++p) {
        const btManifoldPoint& point = manifold.getContactPoint(p);
        const btVector3& a = point.m_positionWorldOnA;
        const btVector3& b = point.m_positionWorldOnB;
        const btVector3& normal = point.m_normalWorldOnB;
        points.push_back({a.x(), a.y(), a.z(), b.x(), b.y(), b.z(), normal.x(), normal.y(), normal.z(),
                          point.getDistance()});
      }
    }
    for (auto& [pair, points] : result) std::sort(points.begin(), points.end());  // of several manifolds
    return result;
  }
  [[nodiscard]] int pair_count() { return world.getPairCache()->getNumOverlappingPairs(); }

  static inline int dispatched = 0;  // by the last world that collided

  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher{&configuration};
  BulletBroadphase broadphase{{.algorithm = "sweep-and-prune"}};
  btCollisionWorld world{&dispatcher, &broadphase, &configuration};
  std::vector<std::unique_ptr<btCollisionObject>> objects;

 private:
  static void count(btBroadphasePair& pair, btCollisionDispatcher& dispatcher, const btDispatcherInfo& info) {
    ++dispatched;
    btCollisionDispatcher::defaultNearCallback(pair, dispatcher, info);
  }
};

/// The same objects in two worlds, one with culling and one without.
class Twins {
 public:
  explicit Twins(Random& random) : random_(random) {}

  btTransform somewhere() {
    const btQuaternion rotation(random_.coordinate(6), random_.coordinate(6), random_.coordinate(6));
    return at(random_.point(6) * btVector3(1, 0.5F, 1), rotation);
  }
  void add(btCollisionShape& shape) {
    const btTransform transform = somewhere();
    for (World* world : {&with, &without}) world->add(shape, transform);
  }
  /// Mostly by so little that contacts last, but now and then to another position.
  void move() {
    for (std::size_t k = 0; k < with.objects.size(); ++k) {
      btTransform transform = with.objects[k]->getWorldTransform();
      if (random_.below(40) == 0) {
        transform = somewhere();
      } else if (random_.below(3) != 0) {
        transform.getOrigin() += (random_.point(2) - btVector3(0.95F, 0.95F, 0.95F)) / 40;
        transform.setRotation(transform.getRotation() *
                              btQuaternion({0, 1, 0}, (random_.coordinate(2) - 1) / 20));
      }
      for (World* world : {&with, &without}) world->objects[k]->setWorldTransform(transform);
    }
  }
  /// Removes an object and adds it again with this shape.
  void exchange(btCollisionShape& shape) {
    const std::size_t k = random_.below(static_cast<unsigned>(with.objects.size()));
    for (World* world : {&with, &without}) {
      btCollisionObject& object = *world->objects[k];
      world->world.removeCollisionObject(&object);
      object.setCollisionShape(&shape);
      world->world.addCollisionObject(&object);
    }
  }
  void fall_asleep() {
    const std::size_t k = random_.below(static_cast<unsigned>(with.objects.size()));
    const int state = random_.below(2) == 0 ? ISLAND_SLEEPING : ACTIVE_TAG;
    for (World* world : {&with, &without}) world->objects[k]->forceActivationState(state);
  }
  void collide() {
    without.collide();
    all_ += World::dispatched;
    with.collide();
    dispatched_ += World::dispatched;
  }
  [[nodiscard]] double dispatched() const { return double(dispatched_) / double(all_); }

  World with{true};
  World without{false};

 private:
  Random& random_;
  long dispatched_ = 0;
  long all_ = 0;
};

void expect_same_contacts(Twins& twins, Random& random, std::vector<btCollisionShape*> shapes,
                          std::size_t& contacts) {
  for (int frame = 0; frame < 100; ++frame) {
    ASSERT_NO_FATAL_FAILURE(twins.collide());
    const Contacts expected = twins.without.contacts();
    ASSERT_EQ(twins.with.contacts(), expected) << "frame " << frame;
    ASSERT_EQ(twins.with.pair_count(), twins.without.pair_count());
    contacts += expected.size();
    twins.move();
    twins.exchange(*shapes[random.below(static_cast<unsigned>(shapes.size()))]);
    twins.fall_asleep();
  }
}

TEST(ShapeCulling, NoContactIsLost) {
  Shapes shapes;
  const std::vector<btCollisionShape*> all = shapes.bounded();
  for (const unsigned seed : {1U, 2U}) {
    Random random(seed);
    Twins twins(random);
    for (int k = 0; k < 90; ++k) twins.add(*all[static_cast<std::size_t>(k) % all.size()]);
    std::size_t contacts = 0;
    ASSERT_NO_FATAL_FAILURE(expect_same_contacts(twins, random, all, contacts));
    EXPECT_GT(contacts, 2000U);
    EXPECT_LT(twins.dispatched(), 0.75);
  }
}

TEST(ShapeCulling, NoContactIsLostThatComesOfTurningShapes) {
  Shapes shapes;
  const std::vector<btCollisionShape*> hulls{&shapes.hull, &shapes.cylinder, &shapes.cone};
  Random random(3);
  Twins twins(random);
  for (World* world : {&twins.with, &twins.without}) {
    world->configuration.setConvexConvexMultipointIterations(4, 4);
    world->world.getDispatchInfo().m_deterministicOverlappingPairs = true;
  }
  for (std::size_t k = 0; k < 60; ++k) twins.add(*hulls[k % hulls.size()]);
  std::size_t contacts = 0;
  ASSERT_NO_FATAL_FAILURE(expect_same_contacts(twins, random, hulls, contacts));
  EXPECT_GT(contacts, 1000U);
  EXPECT_LT(twins.dispatched(), 0.9);
}

TEST(ShapeCulling, NoContactOfOtherShapesIsLost) {
  Shapes shapes;
  std::vector<btCollisionShape*> all = shapes.bounded();
  for (btCollisionShape* shape :
       {static_cast<btCollisionShape*>(&shapes.compound), static_cast<btCollisionShape*>(&shapes.users)}) {
    all.push_back(shape);
  }
  Random random(4);
  Twins twins(random);
  for (World* world : {&twins.with, &twins.without}) {
    for (btCollisionShape* shape :
         {static_cast<btCollisionShape*>(shapes.mesh.get()), static_cast<btCollisionShape*>(&shapes.plane)}) {
      world->add(*shape, at({2, 0, 2}));
    }
  }
  for (std::size_t k = 0; k < 70; ++k) twins.add(*all[k % all.size()]);
  std::size_t contacts = 0;
  ASSERT_NO_FATAL_FAILURE(expect_same_contacts(twins, random, shapes.bounded(), contacts));
  EXPECT_GT(contacts, 1000U);
}

/// Two plates on edge, side by side, turned by 45 degrees: their boxes overlap, but the plates do not.
class Plates : public testing::Test {
 protected:
  static btTransform plate(btScalar distance) {
    const btQuaternion turn({0, 0, 1}, SIMD_PI / 4);
    return at(quatRotate(turn, {0, distance, 0}), turn);
  }
  /// The number of pairs that are dispatched if an object of this shape replaces one plate.
  int dispatched(World& world, btCollisionShape& shape) {
    world.add(flat_, plate(0));
    world.add(shape, plate(1));
    world.collide();
    EXPECT_EQ(world.pair_count(), 1);
    return World::dispatched;
  }

  btBoxShape flat_{{2, 0.1F, 2}};
};

TEST_F(Plates, AreNotDispatched) {
  World with(true);
  World without(false);
  EXPECT_EQ(dispatched(without, flat_), 1);
  EXPECT_EQ(dispatched(with, flat_), 0);
  EXPECT_EQ(with.dispatcher.getNumManifolds(), 0);
  with.broadphase.set_shape_culling(nullptr);
  with.collide();
  EXPECT_EQ(World::dispatched, 1);
}

TEST_F(Plates, LoseTheirAlgorithmWhenTheyMoveApartAndGetItBack) {
  World world(true);
  world.add(flat_, plate(0));
  btCollisionObject& mover = world.add(flat_, plate(0.19F));
  for (int k = 0; k < 3; ++k) {
    mover.setWorldTransform(plate(0.19F));
    world.collide();
    EXPECT_EQ(world.contacts().size(), 1U);
    mover.setWorldTransform(plate(1));
    world.collide();  // here Bullet ends the contacts
    EXPECT_TRUE(world.contacts().empty());
    world.collide();
    EXPECT_EQ(world.dispatcher.getNumManifolds(), 0);
    const btBroadphasePair& pair = world.world.getPairCache()->getOverlappingPairArray()[0];
    EXPECT_EQ(pair.m_algorithm, nullptr);
    EXPECT_EQ(world.pair_count(), 1);
  }
}

/// Bullet keeps a contact whose points have passed each other, so that it can push the objects back.
TEST_F(Plates, KeepAContactThroughWhichTheyPassed) {
  World with(true);
  World without(false);
  for (World* world : {&with, &without}) {
    world->add(flat_, plate(0));
    btCollisionObject& mover = world->add(flat_, plate(0.19F));
    world->collide();
    mover.setWorldTransform(plate(-0.5F));
    for (int k = 0; k < 3; ++k) world->collide();
  }
  ASSERT_EQ(without.contacts().size(), 1U);
  EXPECT_LT(without.contacts().begin()->second[0].back(), -0.5F);
  EXPECT_EQ(with.contacts(), without.contacts());
}

TEST_F(Plates, AreDispatchedIfTheWorldIsNotTheirs) {
  World other(false);
  btCollisionObject of_none;
  of_none.setCollisionShape(&flat_);
  of_none.setWorldTransform(plate(1));
  for (btCollisionObject* stranger : {&of_none, &other.add(flat_, plate(1))}) {
    World world(true);
    world.add(flat_, plate(0));
    btVector3 lower;
    btVector3 upper;
    flat_.getAabb(plate(1), lower, upper);
    btBroadphaseProxy* proxy = world.broadphase.createProxy(lower, upper, BOX_SHAPE_PROXYTYPE, stranger, 1,
                                                            test::all_bits, &world.dispatcher);
    world.collide();
    EXPECT_EQ(World::dispatched, 1);
    world.broadphase.destroyProxy(proxy, &world.dispatcher);
    // Its slot again, now with an object of the world.
    world.add(flat_, plate(1));
    world.collide();
    EXPECT_EQ(World::dispatched, 0);
  }
}

TEST_F(Plates, AreDispatchedIfTheyMayTouchWithinTheStep) {
  World world(true);
  world.world.getDispatchInfo().m_dispatchFunc = btDispatcherInfo::DISPATCH_CONTINUOUS;
  EXPECT_EQ(dispatched(world, flat_), 1);
}

TEST_F(Plates, AreDispatchedIfTheirTransformIsNone) {
  for (const btScalar factor : {btScalar(1.01), btScalar(0), std::numeric_limits<btScalar>::quiet_NaN()}) {
    World world(true);
    world.add(flat_, plate(0));
    btCollisionObject& object = world.add(flat_, plate(1));
    world.collide();
    EXPECT_EQ(World::dispatched, 0);
    const btTransform& transform = object.getWorldTransform();
    object.getWorldTransform().setBasis(transform.getBasis().scaled({factor, factor, factor}));
    world.dispatcher.dispatchAllCollisionPairs(world.world.getPairCache(), world.world.getDispatchInfo(),
                                               &world.dispatcher);
    EXPECT_EQ(World::dispatched, 1) << factor;
  }
}

TEST_F(Plates, AreDispatchedIfAManifoldIsOlderThanTheShape) {
  World world(true);
  world.add(flat_, plate(0));
  btCollisionObject& mover = world.add(flat_, plate(0.19F));
  world.collide();
  world.dispatcher.getManifoldByIndexInternal(0)->setContactBreakingThreshold(2);
  world.dispatcher.clearManifold(world.dispatcher.getManifoldByIndexInternal(0));
  mover.setWorldTransform(plate(1));
  world.collide();
  EXPECT_EQ(World::dispatched, 1);
}

/// A manifold of a kinematic object keeps the other one awake, even without contacts.
TEST_F(Plates, AreDispatchedIfOneIsKinematic) {
  World world(true);
  world.add(flat_, plate(0));
  world.add(flat_, plate(1)).setCollisionFlags(btCollisionObject::CF_KINEMATIC_OBJECT);
  world.collide();
  EXPECT_EQ(World::dispatched, 1);
}

TEST_F(Plates, OfWhichBothSleepMayHaveNoShape) {
  World world(true);
  world.world.setForceUpdateAllAabbs(false);
  for (const btScalar distance : {btScalar(0), btScalar(1)}) world.add(flat_, plate(distance));
  world.collide();
  EXPECT_EQ(World::dispatched, 0);
  for (const auto& object : world.objects) {
    object->forceActivationState(ISLAND_SLEEPING);
    object->setCollisionShape(nullptr);
  }
  world.collide();
  EXPECT_EQ(World::dispatched, 1);
  for (const auto& object : world.objects) object->setCollisionShape(&flat_);
}

/// Their algorithms are those of the world that dispatched them first.
TEST_F(Plates, AreDispatchedByAnotherWorldWithTheSameBroadPhase) {
  World world(true);
  EXPECT_EQ(dispatched(world, flat_), 0);
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btCollisionWorld other(&dispatcher, &world.broadphase, &configuration);
  other.performDiscreteCollisionDetection();
  btOverlappingPairCache& cache = *world.world.getPairCache();
  EXPECT_NE(cache.getOverlappingPairArray()[0].m_algorithm, nullptr);
  cache.cleanOverlappingPair(cache.getOverlappingPairArray()[0], &dispatcher);
}

/// An algorithm that counts how often it is asked for its manifolds.
class Watched final : public btCollisionAlgorithm {
 public:
  int asked = 0;

  void processCollision(const btCollisionObjectWrapper* /*s*/, const btCollisionObjectWrapper* /*t*/,
                        const btDispatcherInfo& /*info*/, btManifoldResult* /*result*/) override {}
  btScalar calculateTimeOfImpact(btCollisionObject* /*s*/, btCollisionObject* /*t*/,
                                 const btDispatcherInfo& /*info*/, btManifoldResult* /*result*/) override {
    return 1;
  }
  void getAllContactManifolds(btManifoldArray& /*manifolds*/) override { ++asked; }
};

/// That of two soft bodies returns manifolds that do not exist.
TEST(ShapeCulling, AsksNoAlgorithmOfUnboundedShapes) {
  Shapes shapes;
  World world(true);
  Watched watched;
  for (int k = 0; k < 2; ++k) world.add(shapes.compound, at({0, 0, 0}));
  world.world.updateAabbs();
  world.world.computeOverlappingPairs();
  btBroadphasePair& pair = world.world.getPairCache()->getOverlappingPairArray()[0];
  pair.m_algorithm = &watched;
  world.dispatcher.dispatchAllCollisionPairs(world.world.getPairCache(), world.world.getDispatchInfo(),
                                             &world.dispatcher);
  pair.m_algorithm = nullptr;
  EXPECT_EQ(watched.asked, 0);
}

TEST(ShapeCulling, IsRefusedIfSomebodyElseWalksThePairs) {
  btSetTaskScheduler(btGetSequentialTaskScheduler());
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btCollisionDispatcherMt dispatcher_mt(&configuration);
  btHashedOverlappingPairCache cache;
  const Config config{.algorithm = "sweep-and-prune"};
  BulletBroadphase own(config);
  BulletBroadphase users(config, &cache);
  btCollisionWorld world(&dispatcher, &own, &configuration);
  btCollisionWorld world_of_user(&dispatcher, &users, &configuration);
  btCollisionWorld world_mt(&dispatcher_mt, &own, &configuration);
  own.set_shape_culling(&world);
  EXPECT_THAT(error_of([&] { users.set_shape_culling(&world_of_user); }), HasSubstr("own pair cache"));
  EXPECT_THAT(error_of([&] { own.set_shape_culling(&world_mt); }), HasSubstr("btCollisionDispatcherMt"));
  EXPECT_THAT(error_of([&] { own.set_shape_culling(&world_of_user); }), HasSubstr("another broad phase"));
  users.set_shape_culling(nullptr);
}

}  // namespace
}  // namespace broadcl
