// A Bullet world with BroadCL. The only line that differs from a world with btDbvtBroadphase is marked.
#include <cstdio>
#include <exception>
#include <memory>
#include <vector>

#include <btBulletDynamicsCommon.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

int main() try {
  // [world]
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btSequentialImpulseConstraintSolver solver;
  broadcl::BulletBroadphase broadphase;  // was: btDbvtBroadphase broadphase;
  btDiscreteDynamicsWorld world(&dispatcher, &broadphase, &solver, &configuration);
  // [world]

  btStaticPlaneShape plane({0, 1, 0}, 0);
  btRigidBody ground(btRigidBody::btRigidBodyConstructionInfo(0, nullptr, &plane));
  world.addRigidBody(&ground);
  btBoxShape box({0.5F, 0.5F, 0.5F});
  btVector3 inertia;
  box.calculateLocalInertia(1, inertia);
  std::vector<std::unique_ptr<btRigidBody>> tower;
  for (int k = 0; k < 10; ++k) {
    btRigidBody::btRigidBodyConstructionInfo info(1, nullptr, &box, inertia);
    info.m_startWorldTransform.setOrigin({0, 0.5F + 1.1F * static_cast<float>(k), 0});
    tower.push_back(std::make_unique<btRigidBody>(info));
    world.addRigidBody(tower.back().get());
  }

  for (int frame = 0; frame < 120; ++frame) world.stepSimulation(1.0F / 60.0F, 0);
  const broadcl::Device* device = broadphase.broad_phase().device();
  std::printf("after 2 s the top box is at a height of %.2f m, with %d pairs found on %s\n",
              static_cast<double>(tower.back()->getWorldTransform().getOrigin().y()),
              broadphase.getOverlappingPairCache()->getNumOverlappingPairs(),
              device != nullptr ? device->label().c_str() : "the host");
  for (const auto& body : tower) world.removeRigidBody(body.get());
  world.removeRigidBody(&ground);
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
