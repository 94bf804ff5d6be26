// A Bullet world without dynamics whose pairs are found on a device while the program does other work. If the
// device is the processor itself, both share its cores.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include <btBulletCollisionCommon.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

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
  std::string device;
  double milliseconds;  // per frame
  int manifolds;        // summed over all frames, to show that the results are the same
  float water;
};

Result simulate(bool async) {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  // The default, `auto`, would stay on the host, where begin() gains nothing.
  broadcl::BulletBroadphase broadphase({.algorithm = "tiles"});
  btCollisionWorld world(&dispatcher, &broadphase, &configuration);

  btSphereShape ball(0.5F);
  std::vector<btCollisionObject> balls(6000);
  for (btCollisionObject& object : balls) {
    object.setCollisionShape(&ball);
    world.addCollisionObject(&object);
  }

  Result result{};
  result.device = broadphase.broad_phase().device()->label();
  std::chrono::steady_clock::time_point start;
  for (int frame = 0; frame <= frames; ++frame) {
    if (frame == 1) start = std::chrono::steady_clock::now();  // the first may compile kernels
    for (int k = 0; k < world.getNumCollisionObjects(); ++k) {
      const btVector3 cell(static_cast<float>(k % 20), static_cast<float>(k / 400),
                           static_cast<float>(k / 20 % 20));
      const float phase = static_cast<float>(k + frame) / 5;
      balls[static_cast<std::size_t>(k)].getWorldTransform().setOrigin(
          1.3F * cell + btVector3(std::sin(phase), std::cos(phase), 0));
    }
    if (async) {
      world.updateAabbs();
      broadphase.begin();
    }
    result.water = std::fmax(result.water, water(frame));
    world.performDiscreteCollisionDetection();
    result.manifolds += dispatcher.getNumManifolds();
  }
  const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
  result.milliseconds = time.count() / frames;
  for (btCollisionObject& object : balls) world.removeCollisionObject(&object);
  return result;
}

int main() try {
  const Result plain = simulate(false);
  const Result async = simulate(true);
  std::printf("pairs found on %s\n", async.device.c_str());
  std::printf("without begin(): %.2f ms per frame\nwith begin():    %.2f ms per frame\n", plain.milliseconds,
              async.milliseconds);
  std::printf("the highest wave has %.2f m\n", static_cast<double>(async.water));
  if (plain.manifolds != async.manifolds || plain.manifolds == 0) {
    std::fprintf(stderr, "the results differ\n");
    return 1;
  }
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
