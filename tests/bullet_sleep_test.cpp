// The cost of a world in which little or nothing moves.
#include <btBulletDynamicsCommon.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <vector>

#include <gtest/gtest.h>

#include "cli/statistics.hpp"
#include "rigid_world.hpp"
#include "runs.hpp"

namespace broadcl {
namespace {

SUITE_NOT_IN(SleepingWorld, sanitizers, "takes long, above all in Bullet");

using test::grid_cell;
using test::RigidWorld;

using Clock = std::chrono::steady_clock;
using Microseconds = std::chrono::duration<double, std::micro>;

/// Counts the calls that it gets.
class CountingCache final : public btHashedOverlappingPairCache {
 public:
  btBroadphasePair* addOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t) override {
    ++calls;
    return btHashedOverlappingPairCache::addOverlappingPair(s, t);
  }
  void* removeOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t, btDispatcher* dispatcher) override {
    ++calls;
    return btHashedOverlappingPairCache::removeOverlappingPair(s, t, dispatcher);
  }
  btBroadphasePair* findPair(btBroadphaseProxy* s, btBroadphaseProxy* t) override {
    ++calls;
    return btHashedOverlappingPairCache::findPair(s, t);
  }
  bool needsBroadphaseCollision(btBroadphaseProxy* s, btBroadphaseProxy* t) const override {
    ++calls;
    return btHashedOverlappingPairCache::needsBroadphaseCollision(s, t);
  }
  btBroadphasePairArray& getOverlappingPairArray() override {
    ++calls;
    return btHashedOverlappingPairCache::getOverlappingPairArray();
  }
  btBroadphasePair* getOverlappingPairArrayPtr() override {
    ++calls;
    return btHashedOverlappingPairCache::getOverlappingPairArrayPtr();
  }

  mutable int calls = 0;
};

/// 30,000 cubes without gravity, all asleep. Every tenth touches the next.
class Sleepers {
 public:
  explicit Sleepers(btBroadphaseInterface& broadphase) : world(broadphase) {
    world.world.setGravity({0, 0, 0});
    for (int k = 0; k < count; ++k) {
      const btVector3 touching(k % 10 == 1 ? -0.4F : 0, 0, 0);
      world.bodies.add_cube(btScalar(1.4) * grid_cell(k, 30, 40) + touching)
          .forceActivationState(ISLAND_SLEEPING);
    }
    world.step();
  }

  /// Wakes this many cubes, evenly spread; they drift along z, past their neighbours.
  void wake(std::size_t awake) const {
    for (std::size_t k = 0; k < awake; ++k) {
      btRigidBody& body = *world.bodies.all()[k * (count / awake) + 1];
      body.forceActivationState(DISABLE_DEACTIVATION);
      body.setLinearVelocity({0, 0, 3});
    }
  }

  static constexpr int count = 30'000;
  RigidWorld world;
};

TEST(SleepingWorld, AsksNothingOfTheDeviceAndTheCache) {
  CountingCache cache;
  BulletBroadphase broadphase({.algorithm = "brute-force"}, &cache);
  Sleepers sleepers(broadphase);
  btDiscreteDynamicsWorld& world = sleepers.world.world;
  EXPECT_EQ(cache.getNumOverlappingPairs(), Sleepers::count / 10);
  // The part of a step before the narrow phase.
  const auto calls_of_calculation = [&] {
    world.updateAabbs();
    cache.calls = 0;
    world.computeOverlappingPairs();
    return cache.calls;
  };
  for (const bool all : {true, false}) {
    world.setForceUpdateAllAabbs(all);
    sleepers.world.step(2);
    EXPECT_TRUE(broadphase.broad_phase().profile().empty());
    EXPECT_EQ(calls_of_calculation(), 0);
    EXPECT_TRUE(broadphase.broad_phase().profile().empty());
  }
  sleepers.wake(10);
  int calls = 0;
  for (int frame = 0; frame < 10; ++frame) {
    sleepers.world.step();
    EXPECT_FALSE(broadphase.broad_phase().profile().empty());
    calls += calls_of_calculation();
  }
  EXPECT_LE(calls, 100) << "only for cubes that move";
}

// The limit is far away even on a busy machine: on two cores of an EPYC it takes about 30 microseconds.
TEST(LongSleepingWorld, CostsNextToNothing) {
  BulletBroadphase ours;
  btDbvtBroadphase tree;
  const std::array<btBroadphaseInterface*, 2> broadphases{&ours, &tree};
  const std::array<const char*, 2> names{"BroadCL", "btDbvtBroadphase"};
  for (std::size_t k = 0; k < broadphases.size(); ++k) {
    Sleepers sleepers(*broadphases[k]);
    btDiscreteDynamicsWorld& world = sleepers.world.world;
    for (const std::size_t awake : {0U, 10U}) {
      sleepers.wake(awake);
      for (const bool all : {false, true}) {
        world.setForceUpdateAllAabbs(all);
        std::vector<double> update;
        std::vector<double> calculate;
        for (int frame = 0; frame < 200; ++frame) {
          sleepers.world.step();
          const auto start = Clock::now();
          world.updateAabbs();
          const auto updated = Clock::now();
          world.computeOverlappingPairs();
          update.push_back(Microseconds(updated - start).count());
          calculate.push_back(Microseconds(Clock::now() - updated).count());
        }
        std::printf(
            "%-16s %2zu awake, boxes of %s: updateAabbs %7.1f us, calculateOverlappingPairs %7.1f us\n",
            names[k], awake, all ? "all  " : "awake", cli::summarize(update).median,
            cli::summarize(calculate).median);
        if (k == 0 && awake == 0) {
          EXPECT_LT(cli::summarize(calculate).median, 1000);
        }
      }
    }
  }
}

}  // namespace
}  // namespace broadcl
