#include <broadcl/bullet.hpp>

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/CollisionDispatch/btGhostObject.h>
#include <BulletDynamics/Featherstone/btMultiBody.h>
#include <BulletDynamics/Featherstone/btMultiBodyConstraintSolver.h>
#include <BulletDynamics/Featherstone/btMultiBodyDynamicsWorld.h>
#include <BulletDynamics/Featherstone/btMultiBodyLinkCollider.h>
#include <btBulletDynamicsCommon.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "expect_error.hpp"
#include "runs.hpp"
#include "scenes/world.hpp"

namespace broadcl {
namespace {

using Ids = std::vector<std::pair<int, int>>;

/// The pair cache in its own order.
Ids cached(btBroadphaseInterface& broadphase) {
  Ids ids;
  const btBroadphasePairArray& pairs = broadphase.getOverlappingPairCache()->getOverlappingPairArray();
  for (int k = 0; k < pairs.size(); ++k) {
    ids.emplace_back(pairs[k].m_pProxy0->m_uniqueId, pairs[k].m_pProxy1->m_uniqueId);
  }
  return ids;
}

/// Some calls on proxies that follow from the seed only.
class Churn {
 public:
  Churn(btBroadphaseInterface& broadphase, unsigned seed) : broadphase_(broadphase), random_(seed) {}

  void run(int calls) {
    for (int k = 0; k < calls; ++k) {
      const std::size_t slot = random_() % proxies_.size();
      const unsigned what = random_() % 8;
      btBroadphaseProxy*& proxy = proxies_[slot];
      const float x = coordinate();
      const float y = coordinate();
      const btVector3 lower(x, y, coordinate());
      const btVector3 upper = lower + btVector3(2, 2, 2);
      if (proxy == nullptr) {
        proxy = broadphase_.createProxy(lower, upper, 0, nullptr, 1 << what % 2, -1, nullptr);
      } else if (what == 0) {
        broadphase_.destroyProxy(proxy, nullptr);
        proxy = nullptr;
      } else if (what == 1) {
        proxy->m_collisionFilterMask ^= 1;
      } else {
        broadphase_.setAabb(proxy, lower, upper, nullptr);
      }
    }
  }

 private:
  float coordinate() { return static_cast<float>(random_() % 80) / 10; }

  btBroadphaseInterface& broadphase_;
  std::mt19937 random_;
  std::array<btBroadphaseProxy*, 60> proxies_{};
};

TEST(BulletAsync, GivesWhatItGivesWithoutWhateverHappensMeanwhile) {
  BulletBroadphase begun;
  BulletBroadphase plain;
  Churn begun_churn(begun, 5);
  Churn plain_churn(plain, 5);
  std::size_t most = 0;
  for (int frame = 0; frame < 200; ++frame) {
    const int before = frame * 7 % 20;
    const int meanwhile = frame * 5 % 30;
    begun_churn.run(before);
    begun.begin();
    if (frame % 10 == 0) begun.begin();
    begun_churn.run(meanwhile);
    begun.calculateOverlappingPairs(nullptr);
    plain_churn.run(before + meanwhile);
    plain.calculateOverlappingPairs(nullptr);
    ASSERT_EQ(cached(begun), cached(plain)) << "frame " << frame;
    most = std::max(most, cached(plain).size());
  }
  EXPECT_GT(most, 50U);
}

TEST(BulletAsync, NothingOfADestroyedProxyComesBack) {
  BulletBroadphase broadphase;
  const auto create = [&](float x) {
    return broadphase.createProxy({x, 0, 0}, {x + 1, 1, 1}, 0, nullptr, 1, -1, nullptr);
  };
  btBroadphaseProxy* old_pair = create(0);
  create(0);
  broadphase.calculateOverlappingPairs(nullptr);
  btBroadphaseProxy* new_pair = create(0);
  broadphase.begin();
  broadphase.destroyProxy(old_pair, nullptr);
  EXPECT_TRUE(cached(broadphase).empty()) << "pairs go at once";
  broadphase.destroyProxy(new_pair, nullptr);
  EXPECT_EQ(create(5)->m_uniqueId, 0) << "the id is in use again";
  broadphase.calculateOverlappingPairs(nullptr);
  EXPECT_TRUE(cached(broadphase).empty());
}

/// Keeps the last bounds that setAabb() was called with, for each proxy.
class Recorder final : public BulletBroadphase {
 public:
  using Bounds = std::pair<btVector3, btVector3>;

  void setAabb(btBroadphaseProxy* proxy, const btVector3& aabbMin, const btVector3& aabbMax,
               btDispatcher* dispatcher) override {
    bounds[proxy] = {aabbMin, aabbMax};
    BulletBroadphase::setAabb(proxy, aabbMin, aabbMax, dispatcher);
  }

  std::map<const btBroadphaseProxy*, Bounds> bounds;
};

bool is_same(const btVector3& s, const btVector3& t) {
  const auto bits = [](const btVector3& v) {
    return std::bit_cast<std::array<std::uint32_t, 3>>(std::array{v.x(), v.y(), v.z()});
  };
  return bits(s) == bits(t);
}

/// Boxes of several kinds in a world: falling, tumbling, damped, at rest, kinematic, static, and a ghost.
class AsyncWorld {
 public:
  explicit AsyncWorld(btBroadphaseInterface& broadphase)
      : world_(&dispatcher_, &broadphase, &solver_, &configuration_) {
    add(0, {0, -1, 0}, {50, 1, 50});
    for (int k = 0; k < 100; ++k) {
      const auto offset = static_cast<float>(k);
      btRigidBody& body = add(1, {offset * 1.5F, 3 + offset / 10, 0}, {0.5F, 0.4F, 0.3F});
      body.setAngularVelocity({offset, 1, 2});
      if (k % 3 == 0) body.setDamping(0.3F, 0.2F);
      if (k % 10 == 0) body.forceActivationState(ISLAND_SLEEPING);
    }
    ghost_.setCollisionShape(shapes_.back().get());
    ghost_.setCollisionFlags(ghost_.getCollisionFlags() | btCollisionObject::CF_NO_CONTACT_RESPONSE);
    world_.addCollisionObject(&ghost_);
    kinematic_ = &add(0, {-5, 1, 0}, {1, 1, 1});
    kinematic_->setCollisionFlags(kinematic_->getCollisionFlags() | btCollisionObject::CF_KINEMATIC_OBJECT);
    kinematic_->setActivationState(DISABLE_DEACTIVATION);
  }
  ~AsyncWorld() {
    world_.removeCollisionObject(&ghost_);
    for (const auto& body : bodies_) world_.removeRigidBody(body.get());
  }
  AsyncWorld(const AsyncWorld&) = delete;
  AsyncWorld& operator=(const AsyncWorld&) = delete;
  AsyncWorld(AsyncWorld&&) = delete;
  AsyncWorld& operator=(AsyncWorld&&) = delete;

  void step() {
    btTransform transform = kinematic_->getWorldTransform();
    transform.getOrigin() += btVector3(0.1F, 0, 0);
    kinematic_->setWorldTransform(transform);
    world_.stepSimulation(time_step, 0);
  }

  btDiscreteDynamicsWorld& bullet() { return world_; }
  btRigidBody& body(int k) { return *bodies_[static_cast<std::size_t>(k)]; }
  [[nodiscard]] const btRigidBody& kinematic() const { return *kinematic_; }

  /// All of the state that moves, bit for bit.
  std::vector<btScalar> state() {
    std::vector<btScalar> result;
    const auto append = [&](const btVector3& v) { result.insert(result.end(), v.m_floats, v.m_floats + 3); };
    const btCollisionObjectArray& objects = world_.getCollisionObjectArray();
    for (int k = 0; k < objects.size(); ++k) {
      btCollisionObject& object = *objects[k];
      for (const btTransform& t : {object.getWorldTransform(), object.getInterpolationWorldTransform()}) {
        append(t.getOrigin());
        for (int row = 0; row < 3; ++row) append(t.getBasis()[row]);
      }
      if (const btRigidBody* body = btRigidBody::upcast(&object)) {
        append(body->getLinearVelocity());
        append(body->getAngularVelocity());
        append(body->getTotalForce());
      }
      append(object.getBroadphaseHandle()->m_aabbMin);
      append(object.getBroadphaseHandle()->m_aabbMax);
      result.push_back(static_cast<btScalar>(object.getActivationState()));
    }
    return result;
  }

  static constexpr btScalar time_step = 1.0F / 60;

 private:
  btRigidBody& add(float mass, const btVector3& position, const btVector3& half_extents) {
    shapes_.push_back(std::make_unique<btBoxShape>(half_extents));
    btVector3 inertia(0, 0, 0);
    if (mass > 0) shapes_.back()->calculateLocalInertia(mass, inertia);
    btRigidBody::btRigidBodyConstructionInfo info(mass, nullptr, shapes_.back().get(), inertia);
    info.m_startWorldTransform.setOrigin(position);
    bodies_.push_back(std::make_unique<btRigidBody>(info));
    world_.addRigidBody(bodies_.back().get());
    return *bodies_.back();
  }

  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btSequentialImpulseConstraintSolver solver_;
  std::vector<std::unique_ptr<btBoxShape>> shapes_;
  std::vector<std::unique_ptr<btRigidBody>> bodies_;
  btRigidBody* kinematic_ = nullptr;
  btGhostObject ghost_;
  btDiscreteDynamicsWorld world_;
};

TEST(BulletAsync, BeginsWithTheVeryBoxesOfTheNextStep) {
  Recorder broadphase;
  AsyncWorld world(broadphase);
  for (int frame = 0; frame < 100; ++frame) {
    world.step();
    broadphase.bounds.clear();
    broadphase.begin(world.bullet(), AsyncWorld::time_step);
    const auto begun = std::exchange(broadphase.bounds, {});
    ASSERT_EQ(begun.size(), 103U);
    world.step();
    for (const auto& [proxy, bounds] : broadphase.bounds) {
      if (proxy == world.kinematic().getBroadphaseHandle()) continue;  // the program moves it
      ASSERT_TRUE(is_same(bounds.first, begun.at(proxy).first) &&
                  is_same(bounds.second, begun.at(proxy).second))
          << "proxy " << proxy->m_uniqueId << ", frame " << frame;
    }
  }
}

TEST(BulletAsync, LeavesTheWorldAsItIs) {
  BulletBroadphase broadphase;
  AsyncWorld world(broadphase);
  for (int frame = 0; frame < 50; ++frame) world.step();
  world.body(7).setLinearVelocity({1e9F, 0, 0});  // its next box will be too large for Bullet
  const std::vector<btScalar> before = world.state();
  broadphase.begin(world.bullet(), AsyncWorld::time_step);
  EXPECT_EQ(world.state(), before);
  broadphase.calculateOverlappingPairs(world.bullet().getDispatcher());
  EXPECT_EQ(world.state(), before);
  world.step();
  EXPECT_EQ(world.body(7).getActivationState(), DISABLE_SIMULATION);
}

TEST(BulletAsync, PredictedBoxesOfObjectsThatGetNoneAreTakenBack) {
  BulletBroadphase begun;
  BulletBroadphase plain;
  AsyncWorld begun_world(begun);
  AsyncWorld plain_world(plain);
  for (int frame = 0; frame < 60; ++frame) {
    begun_world.step();
    plain_world.step();
    begun.begin(begun_world.bullet(), 1);  // far from where they will be
    begun.calculateOverlappingPairs(begun_world.bullet().getDispatcher());
    plain.calculateOverlappingPairs(plain_world.bullet().getDispatcher());
    ASSERT_EQ(cached(begun), cached(plain)) << "frame " << frame;
  }
}

TEST(BulletAsync, AWorldOfMixedBodiesGoesTheSameWay) {
  BulletBroadphase begun;
  BulletBroadphase plain;
  AsyncWorld begun_world(begun);
  AsyncWorld plain_world(plain);
  for (int frame = 0; frame < 300; ++frame) {
    begun_world.step();
    plain_world.step();
    begun.begin(begun_world.bullet(), AsyncWorld::time_step);
    if (frame % 50 == 0) {
      for (AsyncWorld* world : {&begun_world, &plain_world}) {
        world->body(frame % 7 + 1).activate();
        world->body(frame % 7 + 1).setLinearVelocity({3, 9, 0});
      }
    }
    ASSERT_EQ(begun_world.state(), plain_world.state()) << "frame " << frame;
    ASSERT_EQ(cached(begun), cached(plain)) << "frame " << frame;
  }
  EXPECT_FALSE(cached(begun).empty());
}

/// Pairs of hinged boxes that fall on a plane, in Featherstone's coordinates.
class MultiBodyWorld {
 public:
  explicit MultiBodyWorld(btBroadphaseInterface& broadphase)
      : world_(&dispatcher_, &broadphase, &solver_, &configuration_) {
    world_.addRigidBody(&floor_);
    for (int k = 0; k < 8; ++k) add(0.7F * static_cast<float>(k));
  }
  ~MultiBodyWorld() {
    for (const auto& collider : colliders_) world_.removeCollisionObject(collider.get());
    for (const auto& body : bodies_) world_.removeMultiBody(body.get());
    world_.removeRigidBody(&floor_);
  }
  MultiBodyWorld(const MultiBodyWorld&) = delete;
  MultiBodyWorld& operator=(const MultiBodyWorld&) = delete;
  MultiBodyWorld(MultiBodyWorld&&) = delete;
  MultiBodyWorld& operator=(MultiBodyWorld&&) = delete;

  void step() { world_.stepSimulation(AsyncWorld::time_step, 0); }
  btMultiBodyDynamicsWorld& bullet() { return world_; }
  std::vector<btScalar> state() {
    std::vector<btScalar> result;
    for (const auto& collider : colliders_) {
      const btVector3& origin = collider->getWorldTransform().getOrigin();
      result.insert(result.end(), origin.m_floats, origin.m_floats + 3);
    }
    return result;
  }

 private:
  void add(float x) {
    bodies_.push_back(std::make_unique<btMultiBody>(1, 1.0F, btVector3(1, 1, 1), false, false));
    btMultiBody& body = *bodies_.back();
    body.setBasePos({x, 2 + x / 3, 0});
    body.setupRevolute(0, 1, {1, 1, 1}, -1, btQuaternion::getIdentity(), {0, 0, 1}, {0.5F, 0, 0},
                       {0.5F, 0, 0}, true);
    body.finalizeMultiDof();
    world_.addMultiBody(&body);
    for (const int link : {-1, 0}) {
      colliders_.push_back(std::make_unique<btMultiBodyLinkCollider>(&body, link));
      btMultiBodyLinkCollider* collider = colliders_.back().get();
      collider->setCollisionShape(&shape_);
      world_.addCollisionObject(collider, 1, 3);
      if (link < 0) {
        body.setBaseCollider(collider);
      } else {
        body.getLink(link).m_collider = collider;
      }
    }
  }

  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btMultiBodyConstraintSolver solver_;
  btBoxShape shape_{{0.4F, 0.3F, 0.3F}};
  btStaticPlaneShape plane_{{0, 1, 0}, 0};
  btRigidBody floor_{btRigidBody::btRigidBodyConstructionInfo(0, nullptr, &plane_)};
  std::vector<std::unique_ptr<btMultiBody>> bodies_;
  std::vector<std::unique_ptr<btMultiBodyLinkCollider>> colliders_;
  btMultiBodyDynamicsWorld world_;
};

TEST(BulletAsync, AWorldOfMultiBodiesGoesTheSameWay) {
  BulletBroadphase begun;
  BulletBroadphase plain;
  MultiBodyWorld begun_world(begun);
  MultiBodyWorld plain_world(plain);
  const std::vector<btScalar> start = plain_world.state();
  for (int frame = 0; frame < 200; ++frame) {
    begun_world.step();
    plain_world.step();
    begun.begin(begun_world.bullet(), AsyncWorld::time_step);
    ASSERT_EQ(begun_world.state(), plain_world.state()) << "frame " << frame;
    ASSERT_EQ(cached(begun), cached(plain)) << "frame " << frame;
  }
  EXPECT_NE(plain_world.state(), start);
  EXPECT_GT(cached(plain).size(), 10U);
}

TEST(BulletAsync, AWorldOnAnotherBroadPhaseIsAnError) {
  BulletBroadphase broadphase;
  BulletBroadphase other;
  AsyncWorld world(other);
  EXPECT_THAT(test::error_of([&] { broadphase.begin(world.bullet(), 0); }), testing::HasSubstr("begin()"));
}

class EachScenarioAsync : public testing::TestWithParam<std::string> {};

NOT_IN(sanitizers, "takes long");
TEST_P(EachScenarioAsync, GoesTheSameWay) {
  const scenes::Scenario::Config config{.name = GetParam(), .objects = 300};
  BulletBroadphase begun;
  BulletBroadphase plain;
  scenes::World begun_world(config, begun);
  scenes::World plain_world(config, plain);
  for (int frame = 0; frame < 300; ++frame) {
    begun_world.step();
    plain_world.step();
    begun.begin(begun_world.bullet(), scenes::Scenario::frame_seconds);
    for (std::size_t k = 0; k < config.objects; ++k) {
      ASSERT_EQ(begun_world.position(k), plain_world.position(k)) << "object " << k << ", frame " << frame;
    }
    ASSERT_EQ(cached(begun), cached(plain)) << "frame " << frame;
  }
  EXPECT_GT(plain_world.pair_count(), 50U);
}

std::vector<std::string> scenario_names() {
  std::vector<std::string> names;
  for (const scenes::ScenarioInfo& row : scenes::Scenario::list()) names.emplace_back(row.name);
  return names;
}

INSTANTIATE_TEST_SUITE_P(World, EachScenarioAsync, testing::ValuesIn(scenario_names()), [](const auto& test) {
  std::string name = test.param;
  std::erase(name, '-');
  return name;
});

}  // namespace
}  // namespace broadcl
