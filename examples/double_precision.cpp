// Bullet in double precision: the same crowd of cubes at the origin, and 100,000 km from it along each axis,
// where adjacent float32 values are eight metres apart. Its cubes of 1 m stand 0.2 m apart in rows of ten,
// whose cubes touch.
#include <cstdio>
#include <exception>
#include <vector>

#include <btBulletCollisionCommon.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

// Prints how many pairs have boxes that overlap in double precision, and how many if boxes are float32.
void print_pairs(const char* place, const btVector3& origin) {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  broadcl::BulletBroadphase broadphase;
  btCollisionWorld world(&dispatcher, &broadphase, &configuration);

  btBoxShape shape({0.5, 0.5, 0.5});
  std::vector<btCollisionObject> cubes(1000);
  for (int k = 0; k < 1000; ++k) {
    btCollisionObject& cube = cubes[static_cast<std::size_t>(k)];
    cube.setCollisionShape(&shape);
    cube.getWorldTransform().setOrigin(origin + btVector3(k % 10, 1.2 * (k / 10 % 10), 1.2 * (k / 100)));
    world.addCollisionObject(&cube);
  }
  world.computeOverlappingPairs();

  std::vector<broadcl::Aabb64> boxes;
  for (const btCollisionObject& cube : cubes) {
    const btBroadphaseProxy& proxy = *cube.getBroadphaseHandle();
    const btVector3 &lower = proxy.m_aabbMin, &upper = proxy.m_aabbMax;
    boxes.push_back({{lower.x(), lower.y(), lower.z()}, {upper.x(), upper.y(), upper.z()}});
  }
  broadcl::BroadPhase in_float32;  // which rounds them outward

  std::printf("%s: %d pairs, with boxes of float32 %zu\n", place,
              broadphase.getOverlappingPairCache()->getNumOverlappingPairs(),
              in_float32.update(boxes).added.size());
  for (btCollisionObject& cube : cubes) world.removeCollisionObject(&cube);
}

int main() try {
  print_pairs("at the origin", {0, 0, 0});
  print_pairs("far away", {1e8, 1e8, 1e8});
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
