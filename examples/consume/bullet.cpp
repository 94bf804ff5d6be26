// Used by all of the projects with Bullet, as C++17.
#include <btBulletCollisionCommon.h>

#include <broadcl/bullet.hpp>
#include <cstdio>
#include <exception>

static_assert(__cplusplus < 202002L, "the adapter makes no program C++20");

int main() try {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  broadcl::BulletBroadphase broadphase;
  btCollisionWorld world(&dispatcher, &broadphase, &configuration);
  btSphereShape shape(1);
  btCollisionObject left;
  btCollisionObject right;
  right.getWorldTransform().setOrigin({1, 0, 0});
  for (btCollisionObject* object : {&left, &right}) {
    object->setCollisionShape(&shape);
    world.addCollisionObject(object);
  }
  world.performDiscreteCollisionDetection();
  const int pairs = broadphase.getOverlappingPairCache()->getNumOverlappingPairs();
  std::printf("%d pair in Bullet's cache\n", pairs);
  world.removeCollisionObject(&left);
  world.removeCollisionObject(&right);
  return pairs == 1 ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
