// A Bullet world in double precision, a hundred thousand kilometres from the origin, where adjacent float32
// values are eight metres apart. A ball falls beside a thousand cubes of 1 m, which stand 0.2 m apart in rows
// of ten, whose cubes touch. The broad phase finds exactly the pairs whose boxes overlap in double precision.
#include <cmath>
#include <cstdio>
#include <exception>
#include <memory>
#include <vector>

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

  btBoxShape cube_shape({0.5, 0.5, 0.5});
  std::vector<std::unique_ptr<btCollisionObject>> cubes;
  for (int k = 0; k < 1000; ++k) {
    cubes.push_back(std::make_unique<btCollisionObject>());
    cubes.back()->setCollisionShape(&cube_shape);
    cubes.back()->getWorldTransform().setOrigin(
        far_away + btVector3(100 + k % 10, 1.2 * (k / 10 % 10), 1.2 * (k / 100)));
    world.addCollisionObject(cubes.back().get());
  }

  for (int frame = 0; frame < 240; ++frame) world.stepSimulation(1.0 / 60, 0);
  const btVector3 rest = ball.getWorldTransform().getOrigin() - far_away;
  std::printf("the ball rests %.3f m from the floor and %.3f m from its centre\n", std::abs(rest.y() - 0.5),
              rest.x());
  std::printf("%d pairs of cubes and of the ball and the floor\n",
              world.getPairCache()->getNumOverlappingPairs());
  for (const auto& cube : cubes) world.removeCollisionObject(cube.get());
  world.removeRigidBody(&ball);
  world.removeRigidBody(&floor);
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
