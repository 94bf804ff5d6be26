// Statements 29 to 33 of Bullet's contract: the lifetime of a broad phase, and worlds on it.
#include <BulletSoftBody/btSoftBodyHelpers.h>
#include <BulletSoftBody/btSoftBodyRigidBodyCollisionConfiguration.h>
#include <BulletSoftBody/btSoftRigidDynamicsWorld.h>
#include <btBulletDynamicsCommon.h>

#include <array>
#include <cstddef>
#include <memory>
#include <vector>

#include "bullet_contract.hpp"

namespace broadcl::test {
namespace {

TEST_P(Contract, S29TheUnionOfAllBoxes) {
  Rig rig(GetParam());
  btVector3 lower;
  btVector3 upper;
  rig.broadphase().getBroadphaseAabb(lower, upper);
  rig.create({-3, 0, 0}, {1, 1, 1});
  btBroadphaseProxy* mover = rig.create_unit(0);
  rig.move(mover, {2, 3, 4}, {50, 60, 70});
  rig.broadphase().getBroadphaseAabb(lower, upper);
  btVector3 least(-3, 0, 0);
  btVector3 most(50, 60, 70);
  least.setMin(lower);
  most.setMax(upper);
  EXPECT_EQ(lower, least);
  EXPECT_EQ(upper, most);
}

TEST_P(Contract, S30ResetPoolRestartsIdsOfAnEmptyPoolOnly) {
  fails("Simple", "it has no reset, and gives the ids back in the order of destruction");
  Rig rig(GetParam());
  std::array<int, 5> first_ids{};
  for (int& id : first_ids) id = rig.create_unit(0)->m_uniqueId;
  rig.calculate();
  rig.broadphase().resetPool(&rig.dispatcher());
  EXPECT_EQ(rig.pair_count(), 10) << "the proxies still exist";
  for (const std::size_t k : {2U, 0U, 1U, 1U, 0U}) rig.destroy(rig.proxies()[k]);
  rig.calculate();
  rig.broadphase().resetPool(&rig.dispatcher());
  for (const int id : first_ids) EXPECT_EQ(rig.create_unit(0)->m_uniqueId, id);
}

TEST_P(Contract, S31TheEndCopesWithLiveProxiesAndADeadDispatcher) {
  if (unfit("Tree", "proxies that live leak") || unfit("Sweep", "its tree for rays leaks them")) return;
  btDefaultCollisionConfiguration configuration;
  auto dispatcher = std::make_unique<btCollisionDispatcher>(&configuration);
  bool dead = false;
  int ends = 0;
  int client = 0;
  {
    MortalCache cache(dead);
    const auto broadphase = GetParam().make(&cache);
    for (int k = 0; k < 3; ++k) {
      broadphase->createProxy({0, 0, 0}, {1, 1, 1}, 0, &client, 1, all_bits, dispatcher.get());
    }
    broadphase->calculateOverlappingPairs(dispatcher.get());
    ASSERT_EQ(cache.getNumOverlappingPairs(), 3);
    cache.getOverlappingPairArray()[0].m_algorithm = MortalAlgorithm::make(*dispatcher, [&] { ++ends; });
    dispatcher.reset();
  }
  EXPECT_TRUE(dead);
  EXPECT_EQ(ends, 0);
}

/// Boxes that fall on a floor.
class FallingWorld {
 public:
  explicit FallingWorld(btBroadphaseInterface& broadphase)
      : world(&dispatcher_, &broadphase, &solver_, &configuration_) {
    world.addRigidBody(&floor_);
    for (int k = 0; k < 40; ++k) add();
  }
  ~FallingWorld() {
    for (const auto& body : bodies) world.removeRigidBody(body.get());
    world.removeRigidBody(&floor_);
  }
  FallingWorld(const FallingWorld&) = delete;
  FallingWorld& operator=(const FallingWorld&) = delete;
  FallingWorld(FallingWorld&&) = delete;
  FallingWorld& operator=(FallingWorld&&) = delete;

  void add() {
    btRigidBody::btRigidBodyConstructionInfo info(1, nullptr, &box_, {1, 1, 1});
    info.m_startWorldTransform.setOrigin(random_.point(5) + btVector3(0, 1, 0));
    bodies.push_back(std::make_unique<btRigidBody>(info));
    world.addRigidBody(bodies.back().get());
  }
  void remove_first() {
    world.removeRigidBody(bodies.front().get());
    bodies.erase(bodies.begin());
  }

 private:
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btSequentialImpulseConstraintSolver solver_;
  btBoxShape box_{{0.4F, 0.4F, 0.4F}};
  btStaticPlaneShape plane_{{0, 1, 0}, 0};
  btRigidBody floor_{btRigidBody::btRigidBodyConstructionInfo(0, nullptr, &plane_)};
  Random random_{12};

 public:
  std::vector<std::unique_ptr<btRigidBody>> bodies;
  btDiscreteDynamicsWorld world;
};

TEST_P(Contract, S32TickCallbacksMayAddAndRemove) {
  const std::unique_ptr<btBroadphaseInterface> broadphase = GetParam().make(nullptr);
  FallingWorld falling(*broadphase);
  const auto tick = [](btDynamicsWorld* world, btScalar /*time_step*/) {
    auto& self = *static_cast<FallingWorld*>(world->getWorldUserInfo());
    self.remove_first();
    self.add();
  };
  falling.world.setInternalTickCallback(tick, &falling, true);
  falling.world.setInternalTickCallback(tick, &falling, false);
  for (int frame = 0; frame < 100; ++frame)
    falling.world.stepSimulation(btScalar(1) / 30, 2, btScalar(1) / 60);
  falling.world.setInternalTickCallback(nullptr, nullptr, true);
  falling.world.setInternalTickCallback(nullptr, nullptr, false);
  falling.world.stepSimulation(btScalar(1) / 60, 0);
  EXPECT_EQ(falling.bodies.size(), 40U);
  std::vector<const btBroadphaseProxy*> proxies;
  for (const auto& body : falling.bodies) proxies.push_back(body->getBroadphaseProxy());
  EXPECT_EQ(missing(*broadphase->getOverlappingPairCache(), proxies), 0);
  EXPECT_GT(broadphase->getOverlappingPairCache()->getNumOverlappingPairs(), 20);
}

TEST_P(Contract, S33SoftWorldsRunOnIt) {
  const std::unique_ptr<btBroadphaseInterface> broadphase = GetParam().make(nullptr);
  btSoftBodyRigidBodyCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btSequentialImpulseConstraintSolver solver;
  btSoftRigidDynamicsWorld world(&dispatcher, broadphase.get(), &solver, &configuration);
  EXPECT_EQ(world.getWorldInfo().m_broadphase, broadphase.get());
  world.getWorldInfo().m_sparsesdf.Initialize();
  btBoxShape shape({10, 1, 10});
  btRigidBody floor(btRigidBody::btRigidBodyConstructionInfo(0, nullptr, &shape));
  world.addRigidBody(&floor);
  btSoftBody* cloth = btSoftBodyHelpers::CreatePatch(world.getWorldInfo(), {-2, 3, -2}, {2, 3, -2},
                                                     {-2, 3, 2}, {2, 3, 2}, 8, 8, 0, true);
  world.addSoftBody(cloth);
  for (int frame = 0; frame < 120; ++frame) world.stepSimulation(btScalar(1) / 60, 0);
  EXPECT_EQ(broadphase->getOverlappingPairCache()->getNumOverlappingPairs(), 1);
  for (int k = 0; k < cloth->m_nodes.size(); ++k) {
    EXPECT_GT(cloth->m_nodes[k].m_x.y(), 0.5F);
    EXPECT_LT(cloth->m_nodes[k].m_x.y(), 2);
  }
  world.removeSoftBody(cloth);
  delete cloth;  // NOLINT(cppcoreguidelines-owning-memory): Bullet gives it as a raw pointer
  world.removeRigidBody(&floor);
}

}  // namespace
}  // namespace broadcl::test
