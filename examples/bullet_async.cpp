// A Bullet world whose pairs are found on the device while the program does other work between two steps.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <memory>
#include <vector>

#include <btBulletDynamicsCommon.h>

#include <broadcl/bullet.hpp>

constexpr float time_step = 1.0F / 60;
constexpr int frames = 60;

// The other work: a water surface of many waves, some milliseconds of computation.
float water(int frame) {
  float highest = 0;
  for (int x = 0; x < 300; ++x) {
    for (int y = 0; y < 300; ++y) {
      float height = 0;
      for (int wave = 1; wave <= 4; ++wave) {
        height +=
            std::sin(static_cast<float>(x * wave + frame) / 9) * std::cos(static_cast<float>(y * wave) / 7);
      }
      highest = std::fmax(highest, height);
    }
  }
  return highest;
}

struct Result {
  double milliseconds;  // per frame
  float height;         // of the last box, to show that the simulations are the same
  float water;
};

Result simulate(bool async) {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btSequentialImpulseConstraintSolver solver;
  broadcl::BulletBroadphase broadphase;
  btDiscreteDynamicsWorld world(&dispatcher, &broadphase, &solver, &configuration);

  btStaticPlaneShape plane({0, 1, 0}, 0);
  btRigidBody ground(btRigidBody::btRigidBodyConstructionInfo(0, nullptr, &plane));
  world.addRigidBody(&ground);
  btBoxShape box({0.5F, 0.5F, 0.5F});
  btVector3 inertia;
  box.calculateLocalInertia(1, inertia);
  std::vector<std::unique_ptr<btRigidBody>> boxes;
  for (int k = 0; k < 6000; ++k) {
    btRigidBody::btRigidBodyConstructionInfo info(1, nullptr, &box, inertia);
    const btVector3 cell(static_cast<float>(k % 20), static_cast<float>(k / 400),
                         static_cast<float>(k / 20 % 20));
    info.m_startWorldTransform.setOrigin(1.3F * cell + btVector3(0, 3, 0));
    boxes.push_back(std::make_unique<btRigidBody>(info));
    world.addRigidBody(boxes.back().get());
  }

  Result result{};
  const auto start = std::chrono::steady_clock::now();
  for (int frame = 0; frame < frames; ++frame) {
    world.stepSimulation(time_step, 0);
    if (async) broadphase.begin(world, time_step);  // the only line more; the next step collects the pairs
    result.water = std::fmax(result.water, water(frame));
  }
  const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
  result.milliseconds = time.count() / frames;
  result.height = boxes.back()->getWorldTransform().getOrigin().y();
  for (const auto& body : boxes) world.removeRigidBody(body.get());
  world.removeRigidBody(&ground);
  return result;
}

int main() try {
  const Result plain = simulate(false);
  const Result async = simulate(true);
  std::printf("without begin(): %.2f ms per frame\nwith begin():    %.2f ms per frame\n", plain.milliseconds,
              async.milliseconds);
  std::printf("gain:            %.2f ms; highest wave %.2f m\n", plain.milliseconds - async.milliseconds,
              static_cast<double>(async.water));
  if (plain.height != async.height) {
    std::fprintf(stderr, "the simulations differ\n");
    return 1;
  }
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
