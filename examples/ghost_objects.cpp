// A sensor: a zone that objects pass through and that reports which objects enter and leave it.
#include <cstdio>
#include <exception>
#include <memory>
#include <set>
#include <vector>

#include <BulletCollision/CollisionDispatch/btGhostObject.h>
#include <btBulletDynamicsCommon.h>

#include <broadcl/bullet.hpp>

// The numbers of the objects whose boxes overlap the zone's.
std::set<int> inside(const btGhostObject& zone) {
  std::set<int> numbers;
  for (int k = 0; k < zone.getNumOverlappingObjects(); ++k) {
    numbers.insert(zone.getOverlappingObject(k)->getUserIndex());
  }
  return numbers;
}

int main() try {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btSequentialImpulseConstraintSolver solver;
  broadcl::BulletBroadphase broadphase;
  btGhostPairCallback ghosts;  // without it ghost objects are not notified of their pairs
  broadphase.getOverlappingPairCache()->setInternalGhostPairCallback(&ghosts);
  btDiscreteDynamicsWorld world(&dispatcher, &broadphase, &solver, &configuration);
  world.setGravity({0, 0, 0});

  btBoxShape zone_shape({2, 1, 1});
  btPairCachingGhostObject zone;  // from x = -2 to 2
  zone.setCollisionShape(&zone_shape);
  zone.setCollisionFlags(zone.getCollisionFlags() | btCollisionObject::CF_NO_CONTACT_RESPONSE);
  world.addCollisionObject(&zone);

  btSphereShape ball_shape(0.5F);
  std::vector<std::unique_ptr<btRigidBody>> balls;
  for (int k = 0; k < 3; ++k) {
    btRigidBody::btRigidBodyConstructionInfo info(1, nullptr, &ball_shape);
    info.m_startWorldTransform.setOrigin({-5.0F - 2.0F * static_cast<float>(k), 0, 0});
    balls.push_back(std::make_unique<btRigidBody>(info));
    balls.back()->setUserIndex(k);
    balls.back()->setLinearVelocity({3, 0, 0});
    world.addRigidBody(balls.back().get());
  }

  std::set<int> before;
  for (int frame = 1; frame <= 300; ++frame) {
    world.stepSimulation(1.0F / 60.0F, 0);
    const std::set<int> now = inside(zone);
    for (const int k : now) {
      if (before.count(k) == 0) std::printf("frame %d: ball %d enters\n", frame, k);
    }
    for (const int k : before) {
      if (now.count(k) == 0) std::printf("frame %d: ball %d leaves\n", frame, k);
    }
    before = now;
  }
  for (const auto& ball : balls) world.removeRigidBody(ball.get());
  world.removeCollisionObject(&zone);
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
