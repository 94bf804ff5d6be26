// A Bullet world in double precision, a hundred thousand kilometres from the origin, where adjacent float32
// values are eight metres apart: the device finds pairs of boxes that are rounded outward, and Bullet does
// the rest exactly.
#include <cmath>
#include <cstdio>
#include <exception>

#include <btBulletDynamicsCommon.h>

#include <broadcl/bullet.hpp>

int main() try {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btSequentialImpulseConstraintSolver solver;
  broadcl::BulletBroadphase broadphase;
  btDiscreteDynamicsWorld world(&dispatcher, &broadphase, &solver, &configuration);

  const btVector3 far_away(1e8, 0, 0);
  btBoxShape floor_shape({10, 1, 10});
  btRigidBody floor(btRigidBody::btRigidBodyConstructionInfo(0, nullptr, &floor_shape));
  floor.getWorldTransform().setOrigin(far_away - btVector3(0, 1, 0));
  world.addRigidBody(&floor);

  btSphereShape ball_shape(0.5);
  btVector3 inertia;
  ball_shape.calculateLocalInertia(1, inertia);
  btRigidBody::btRigidBodyConstructionInfo info(1, nullptr, &ball_shape, inertia);
  info.m_startWorldTransform.setOrigin(far_away + btVector3(0.25, 3, 0));
  btRigidBody ball(info);
  world.addRigidBody(&ball);

  for (int frame = 0; frame < 240; ++frame) world.stepSimulation(1.0 / 60, 0);
  const btVector3 rest = ball.getWorldTransform().getOrigin() - far_away;
  std::printf("the ball rests %.3f m from the floor and %.3f m from its centre\n", std::abs(rest.y() - 0.5),
              rest.x());
  world.removeRigidBody(&ball);
  world.removeRigidBody(&floor);
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
