// A game that goes back: a world of Bullet is set back, and the pairs follow (docs/bullet.md).
#include <BulletCollision/NarrowPhaseCollision/btPersistentManifold.h>
#include <btBulletDynamicsCommon.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "bullet_rig.hpp"
#include "rigid_world.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

using test::grid_cell;
using test::Kind;
using test::kinds;
using test::RigidWorld;

constexpr int steps = 400;

const Kind& kind_of(const std::string& name) {
  return *std::ranges::find(kinds, name, &Kind::name);
}

/// Boxes, balls and capsules that fall in a heap; now and then, one is kicked.
class Heap {
 public:
  explicit Heap(const Kind& kind) : broadphase_(kind.make(nullptr)) {
    world_.world.getDispatchInfo().m_deterministicOverlappingPairs = true;
    world_.bodies.add_floor();
    for (int k = 0; k < count; ++k) {
      const btScalar wobble = btScalar(k * 7 % 11) / 40;
      const btVector3 position =
          grid_cell(k, 4, 6) * btVector3(1.1F, 1.3F, 1.2F) + btVector3(wobble, 1, -wobble);
      world_.bodies.add(*shapes_.at(static_cast<std::size_t>(k) % shapes_.size()), 1, position);
      world_.bodies.all().back()->setRollingFriction(0.02F);
    }
  }

  /// @param player Decides which bodies are kicked.
  void run(int from, int to, int player = 0) {
    for (int step = from; step < to; ++step) {
      if (step % 8 == 0) kick(*world_.bodies.all().at(kicked(step, player)), step, player);
      world_.step();
    }
  }

  [[nodiscard]] RigidWorld& world() { return world_; }
  [[nodiscard]] int asleep() const {
    return static_cast<int>(std::ranges::count_if(
        world_.bodies.all(), [](const auto& body) { return body->getActivationState() == ISLAND_SLEEPING; }));
  }
  /// Of all bodies, bit for bit.
  [[nodiscard]] std::vector<btScalar> everything() const {
    std::vector<btScalar> result;
    for (const auto& body : world_.bodies.all()) {
      const btMatrix3x3& basis = body->getWorldTransform().getBasis();
      for (const btVector3& v : {basis[0], basis[1], basis[2], body->getWorldTransform().getOrigin(),
                                 body->getLinearVelocity(), body->getAngularVelocity()}) {
        result.insert(result.end(), v.m_floats, v.m_floats + 3);
      }
      result.push_back(body->getDeactivationTime());
      result.push_back(static_cast<btScalar>(body->getActivationState()));
    }
    return result;
  }

 private:
  static constexpr int count = 90;

  static std::size_t kicked(int step, int player) {
    return static_cast<std::size_t>(1 + (5 * step + 17 * player) % count);
  }
  static void kick(btRigidBody& body, int step, int player) {
    body.activate();
    body.applyImpulse({btScalar(player + 1), 4, btScalar(step % 5 - 2)}, {0.1F, 0, 0.2F});
  }

  btBoxShape box_{{0.5F, 0.4F, 0.3F}};
  btSphereShape ball_{0.45F};
  btCapsuleShape capsule_{0.3F, 0.5F};
  std::array<btCollisionShape*, 3> shapes_{&box_, &ball_, &capsule_};
  std::unique_ptr<btBroadphaseInterface> broadphase_;
  RigidWorld world_{*broadphase_};
};

/// What a world of rigid bodies needs to go on from here, bit for bit.
class Saved {
 public:
  explicit Saved(btDynamicsWorld& world) {
    for (int k = 0; k < world.getNumCollisionObjects(); ++k)
      bodies_.emplace_back(*btRigidBody::upcast(world.getCollisionObjectArray()[k]));
    btDispatcher& dispatcher = *world.getDispatcher();
    for (int k = 0; k < dispatcher.getNumManifolds(); ++k) {
      const btPersistentManifold& manifold = *dispatcher.getManifoldByIndexInternal(k);
      std::vector<btManifoldPoint>& contacts = contacts_[pair_of(manifold)];
      for (int c = 0; c < manifold.getNumContacts(); ++c) contacts.push_back(manifold.getContactPoint(c));
    }
  }

  /// @param world With the same bodies, added in the same order.
  void restore(btDynamicsWorld& world) const {
    const auto body = [&](int k) { return btRigidBody::upcast(world.getCollisionObjectArray()[k]); };
    for (int k = 0; k < world.getNumCollisionObjects(); ++k)
      bodies_[static_cast<std::size_t>(k)].restore(*body(k));
    // All bodies are active, so that each pair gets its contacts. Those of the saved moment replace them.
    world.performDiscreteCollisionDetection();
    btDispatcher& dispatcher = *world.getDispatcher();
    for (int k = 0; k < dispatcher.getNumManifolds(); ++k) {
      btPersistentManifold& manifold = *dispatcher.getManifoldByIndexInternal(k);
      manifold.clearManifold();
      const auto contacts = contacts_.find(pair_of(manifold));
      if (contacts == contacts_.end()) continue;
      for (const btManifoldPoint& contact : contacts->second) manifold.addManifoldPoint(contact);
    }
    for (int k = 0; k < world.getNumCollisionObjects(); ++k)
      body(k)->forceActivationState(bodies_[static_cast<std::size_t>(k)].activation);
  }

 private:
  struct Body {
    explicit Body(const btRigidBody& body)
        : transform(body.getWorldTransform()),
          interpolated(body.getInterpolationWorldTransform()),
          linear(body.getLinearVelocity()),
          angular(body.getAngularVelocity()),
          still_for(body.getDeactivationTime()),
          activation(body.getActivationState()) {}

    void restore(btRigidBody& body) const {
      body.setLinearVelocity(linear);
      body.setAngularVelocity(angular);
      body.setCenterOfMassTransform(transform);  // which updates the tensor of inertia, too
      body.setInterpolationWorldTransform(interpolated);
      body.clearForces();
      body.setDeactivationTime(still_for);
      body.forceActivationState(ACTIVE_TAG);
    }

    btTransform transform, interpolated;
    btVector3 linear, angular;
    btScalar still_for;
    int activation;
  };

  static std::pair<int, int> pair_of(const btPersistentManifold& manifold) {
    return {manifold.getBody0()->getWorldArrayIndex(), manifold.getBody1()->getWorldArrayIndex()};
  }

  std::vector<Body> bodies_;
  std::map<std::pair<int, int>, std::vector<btManifoldPoint>> contacts_;
};

std::vector<btScalar> after_all_steps(const Kind& kind) {
  Heap heap(kind);
  heap.run(0, steps);
  return heap.everything();
}

TEST(BulletRollback, BodiesEndBitEqualWithOtherBroadPhasesThatHaveTheSamePairs) {
  Heap heap(kind_of("BroadCL"));
  std::set<int> asleep;
  for (int step = 0; step < steps; ++step) {
    heap.run(step, step + 1);
    asleep.insert(heap.asleep());
  }
  ASSERT_GT(asleep.size(), 3U) << "bodies fall asleep and wake";
  for (const char* other : {"BroadCLAtOnce", "Simple", "Sweep"})
    EXPECT_EQ(heap.everything(), after_all_steps(kind_of(other))) << other;
}

/// Of a broad phase whose pairs follow from the boxes alone.
class Rollback : public testing::TestWithParam<Kind> {};
INSTANTIATE_TEST_SUITE_P(Bullet, Rollback,
                         testing::Values(kind_of("BroadCL"), kind_of("BroadCLAtOnce"), kind_of("Simple")),
                         test::named_by_parameter);

TEST_P(Rollback, EndsAsIfNothingElseHadHappened) {
  const std::vector<btScalar> expected = after_all_steps(GetParam());
  Heap heap(GetParam());
  int now = 0;
  for (const int saved_at : {40, 170, 300}) {
    heap.run(now, saved_at);
    const Saved saved(heap.world().world);
    const std::vector<btScalar> moment = heap.everything();
    heap.run(saved_at, saved_at + 60, 1);
    ASSERT_NE(heap.everything(), moment);
    saved.restore(heap.world().world);
    EXPECT_EQ(heap.everything(), moment);
    Heap fresh(GetParam());
    saved.restore(fresh.world().world);
    fresh.run(saved_at, steps);
    EXPECT_EQ(fresh.everything(), expected) << "in another world, saved at " << saved_at;
    now = saved_at;
  }
  heap.run(now, steps);
  EXPECT_EQ(heap.everything(), expected);
}

}  // namespace
}  // namespace broadcl
