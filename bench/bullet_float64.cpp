// Times Bullet in double precision, at several distances from the origin. A program of its own, since
// Bullet's builds in single and double precision cannot be in one.
//
// bullet-in-double/BROADPHASE/DISTANCE  a frame: setAabb() of a thousand cubes of 1 m, all of which move, and
//                                       calculateOverlappingPairs(). They stand 0.2 m apart in rows of ten,
//                                       whose cubes touch: 900 pairs. DISTANCE is in metres.
#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <benchmark/benchmark.h>

#include <broadcl/bullet.hpp>

namespace {

using Make = std::unique_ptr<btBroadphaseInterface> (*)();

void time_frames(benchmark::State& state, Make make, double distance) {
  constexpr int cubes = 1000;
  const std::unique_ptr<btBroadphaseInterface> broadphase = make();
  std::vector<btBroadphaseProxy*> proxies;
  proxies.reserve(cubes);
  int frame = 0;
  const auto lower = [&](int k) {
    const double sway = 0.25 * (frame % 4);  // a number of float32, too, so that cubes touch everywhere
    const int row = k / 10 % 10;
    const int layer = k / 100;
    return btVector3(distance + k % 10 + sway, 1.2 * row, 1.2 * layer);
  };
  const btVector3 edge(1, 1, 1);
  for (int k = 0; k < cubes; ++k) {
    proxies.push_back(broadphase->createProxy(lower(k), lower(k) + edge, 0, nullptr, 1, -1, nullptr));
  }
  const auto update = [&] {
    ++frame;
    const auto start = std::chrono::steady_clock::now();
    for (int k = 0; k < cubes; ++k) {
      broadphase->setAabb(proxies[static_cast<std::size_t>(k)], lower(k), lower(k) + edge, nullptr);
    }
    broadphase->calculateOverlappingPairs(nullptr);
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  for (int k = 0; k < 64; ++k) (void)update();
  for ([[maybe_unused]] auto _ : state) state.SetIterationTime(update());
  state.counters["pairs"] = broadphase->getOverlappingPairCache()->getNumOverlappingPairs();
  for (btBroadphaseProxy* proxy : proxies) broadphase->destroyProxy(proxy, nullptr);
}

}  // namespace

int main(int argc, char** argv) {
  const auto add = [](const std::string& name, Make make) {
    for (const double distance : {0.0, 1e5, 1e6, 6.378e6, 1e7}) {
      const std::string full = "bullet-in-double/" + name + "/" + std::to_string(static_cast<int>(distance));
      benchmark::RegisterBenchmark(full.c_str(), time_frames, make, distance)
          ->UseManualTime()
          ->Unit(benchmark::kMicrosecond);
    }
  };
  add("bullet-bvh",
      []() -> std::unique_ptr<btBroadphaseInterface> { return std::make_unique<btDbvtBroadphase>(); });
  add("sweep-and-prune", []() -> std::unique_ptr<btBroadphaseInterface> {
    return std::make_unique<broadcl::BulletBroadphase>(broadcl::Config{"", "sweep-and-prune"});
  });
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
