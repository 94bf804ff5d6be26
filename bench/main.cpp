// Times kernels, and whole frames side by side with Bullet's own broad phases. `scripts/bench` runs this
// program.
//
// kernel/ALGORITHM/N        device time of the kernel that tests all pairs, and pairs tested per second
// update/ALGORITHM/SCENE/N  BroadPhase::update(), from boxes in the library's staging memory to the changes
//                           on the host, in 256 consecutive frames in which every box moves
// update-from-memory/...    the same from boxes in ordinary memory
// some-moving/ALGORITHM/M/N the same as update, but only M of N boxes move
// some-moving-from-memory/... the same by update() with all boxes in ordinary memory
// some-moving-from-list/... the same by move() with a list of those that move, and update()
// frame/NAME/SCENE/N        a frame through Bullet's interface in which every box moves: setAabb for each,
//                           from ordinary memory, then calculateOverlappingPairs
// frame-some-moving/NAME/M/N  the same, but only M of N boxes move
//
// The other files in this folder have more benchmarks.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <exception>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/CollisionDispatch/btCollisionDispatcher.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>
#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

#include "benchmarks.hpp"
#include "bounds.hpp"
#include "frame_times.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/generators.hpp"

namespace broadcl {
namespace {

using scenes::MovingBoxes;

void time_kernel(benchmark::State& state, const AlgorithmInfo& algorithm, std::uint32_t n) {
  BroadPhase broad_phase({.algorithm = std::string(algorithm.name), .profile = true});
  const MovingBoxes boxes(n, MovingBoxes::Sizes::uniform);
  for (const Aabb& box : boxes.boxes()) broad_phase.add(box);
  (void)broad_phase.update();
  for ([[maybe_unused]] auto _ : state) {
    (void)broad_phase.map(n);  // all boxes count as moved
    (void)broad_phase.update();
    for (const Stage& stage : broad_phase.profile()) {
      if (stage.name == "test") state.SetIterationTime(stage.device_seconds);
    }
  }
  state.counters["pairs"] =
      benchmark::Counter(static_cast<double>(n) * (n - 1) / 2, benchmark::Counter::kIsIterationInvariantRate);
}

std::size_t size(const Delta& delta) {
  return delta.added.size() + delta.removed.size();
}

/// Where boxes are at the beginning of a frame: given to the library already; or in ordinary memory, all of
/// them, or those that move with their ids.
enum class From { staging, memory, list };

void time_update(benchmark::State& state, const AlgorithmInfo& algorithm, const Scene& scene, std::uint32_t n,
                 From from) {
  BroadPhase broad_phase({.algorithm = std::string(algorithm.name)});
  MovingBoxes boxes(n, scene.sizes);
  (void)broad_phase.update(boxes.boxes());
  const auto advance = [&] {
    boxes.advance();
    if (from == From::memory) return;
    for (std::uint32_t id = 0; id < n; ++id) broad_phase.move(id, boxes.boxes()[id]);
  };
  const auto update = [&] {
    return size(from == From::memory ? broad_phase.update(boxes.boxes()) : broad_phase.update());
  };
  warm_up(advance, update);
  FrameTimes frames(state);
  for ([[maybe_unused]] auto _ : state) {
    advance();
    frames.time(update);
  }
  frames.report();
}

void time_some_moving(benchmark::State& state, const AlgorithmInfo& algorithm, std::uint32_t n,
                      std::uint32_t moving, From from) {
  BroadPhase broad_phase({.algorithm = std::string(algorithm.name)});
  MovingBoxes boxes(n, MovingBoxes::Sizes::uniform);
  std::vector<Aabb> present(boxes.boxes().begin(), boxes.boxes().end());
  std::vector<std::uint32_t> ids(moving);
  for (std::uint32_t k = 0; k < moving; ++k) ids[k] = k * (n / moving);
  std::vector<Aabb> moved(moving);
  (void)broad_phase.update(present);
  const auto advance = [&] {
    boxes.advance();
    for (std::uint32_t k = 0; k < moving; ++k) present[ids[k]] = moved[k] = boxes.boxes()[ids[k]];
    if (from == From::staging) broad_phase.move(ids, moved);
  };
  const auto update = [&] {
    if (from == From::memory) return size(broad_phase.update(present));
    if (from == From::list) broad_phase.move(ids, moved);
    return size(broad_phase.update());
  };
  warm_up(advance, update);
  FrameTimes frames(state);
  for ([[maybe_unused]] auto _ : state) {
    advance();
    frames.time(update);
  }
  frames.report();
}

void time_frame(benchmark::State& state, const std::string& name, const Scene& scene, std::uint32_t n,
                std::uint32_t moving) {
  MovingBoxes boxes(n, scene.sizes);
  const auto broadphase =
      scenes::make_broadphase({.name = name, .device = {}, .objects = n, .world_edge = 4 / boxes.edge()});
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  std::vector<btBroadphaseProxy*> proxies;
  // Bullet's brute force skips proxies without a client object.
  for (const Bounds& box : scaled(boxes)) {
    proxies.push_back(
        broadphase->createProxy(box.lower, box.upper, BOX_SHAPE_PROXYTYPE, &state, 1, -1, &dispatcher));
  }
  broadphase->calculateOverlappingPairs(&dispatcher);
  std::vector<Bounds> moved;
  const auto advance = [&] {
    boxes.advance();
    moved = scaled(boxes);
  };
  const auto frame = [&] {
    for (std::size_t j = 0; j < moving; ++j) {
      const std::size_t k = j * (n / moving);
      broadphase->setAabb(proxies[k], moved[k].lower, moved[k].upper, &dispatcher);
    }
    broadphase->calculateOverlappingPairs(&dispatcher);
  };
  warm_up(advance, frame);
  for ([[maybe_unused]] auto _ : state) {
    state.PauseTiming();
    advance();
    state.ResumeTiming();
    frame();
  }
  state.counters["overlapping"] = broadphase->getOverlappingPairCache()->getNumOverlappingPairs();
  for (btBroadphaseProxy* proxy : proxies) broadphase->destroyProxy(proxy, &dispatcher);
}

/// The largest number of boxes for which a frame takes at most a few tenths of a second.
std::uint32_t most_in_frames(const std::string& broadphase) {
  if (broadphase == "bullet-bf") return 3500;
  return broadphase == "brute-force" || broadphase == "gpu-bf" ? 16000 : 64000;
}

void register_all() {
  for (const AlgorithmInfo& algorithm : algorithms()) {
    if (!algorithm.on_device || algorithm.name == "auto") continue;
    for (const std::uint32_t n : {3500U, 16384U, 65536U}) {
      const std::string name = "kernel/" + std::string(algorithm.name) + "/" + std::to_string(n);
      benchmark::RegisterBenchmark(name.c_str(), time_kernel, algorithm, n)
          ->UseManualTime()
          ->Iterations(n > 20000 ? 20 : 200)
          ->Unit(benchmark::kMicrosecond);
    }
  }
  struct SomeMoving {
    std::uint32_t moving, of;
  };
  for (const SomeMoving some :
       {SomeMoving{30, 10'000}, {0, 30'000}, {30, 30'000}, {300, 30'000}, {3000, 30'000}, {30'000, 30'000}}) {
    for (const AlgorithmInfo& algorithm : algorithms()) {
      if (algorithm.name == "oracle" || algorithm.name == "gpu-bf") continue;
      const std::string name = "some-moving/" + std::string(algorithm.name) + "/" +
                               std::to_string(some.moving) + "/" + std::to_string(some.of);
      benchmark::RegisterBenchmark(name.c_str(), time_some_moving, algorithm, some.of, some.moving,
                                   From::staging)
          ->UseManualTime()
          ->Iterations(256)
          ->Unit(benchmark::kMicrosecond);
    }
  }
  for (const SomeMoving some : {SomeMoving{1000, 1'000'000},
                                {10'000, 1'000'000},
                                {500'000, 1'000'000},
                                {1'000'000, 1'000'000},
                                {1000, 5'000'000},
                                {5'000'000, 5'000'000}}) {
    for (const AlgorithmInfo& algorithm : algorithms()) {
      if (algorithm.name != "auto" && algorithm.name != "tiles" && algorithm.name != "sweep-and-prune")
        continue;
      for (const From from : {From::memory, From::list}) {
        const std::string name =
            std::string(from == From::memory ? "some-moving-from-memory/" : "some-moving-from-list/") +
            std::string(algorithm.name) + "/" + std::to_string(some.moving) + "/" + std::to_string(some.of);
        benchmark::RegisterBenchmark(name.c_str(), time_some_moving, algorithm, some.of, some.moving, from)
            ->UseManualTime()
            ->Iterations(64)
            ->Unit(benchmark::kMicrosecond);
      }
    }
  }
  for (const scenes::BroadphaseInfo& info : scenes::broadphases()) {
    if (info.name == "oracle" || most_in_frames(info.name) < 16000) continue;
    const std::string name = "frame-some-moving/" + info.name + "/30/10000";
    benchmark::RegisterBenchmark(name.c_str(), time_frame, info.name, scene_list[0], 10'000U, 30U)
        ->UseRealTime()
        ->Iterations(256)
        ->Unit(benchmark::kMicrosecond);
  }
  for (const Scene& scene : scene_list) {
    for (const std::uint32_t n : {500U, 3500U, 16000U, 64000U, 256000U, 1'000'000U, 10'000'000U}) {
      for (const AlgorithmInfo& algorithm : algorithms()) {
        // Algorithms that test all pairs take too long beyond that.
        const std::uint32_t most = algorithm.name == "brute-force" ? 16000
                                   : algorithm.name == "gpu-bf"    ? 3500
                                                                   : 10'000'000;
        if (algorithm.name == "oracle" || n > most) continue;
        if (n > 1'000'000 && (algorithm.name != "tiles" || scene.sizes == MovingBoxes::Sizes::mixed))
          continue;
        for (const From from : {From::staging, From::memory}) {
          if (n > 1'000'000 && from == From::memory) continue;
          const std::string name = std::string(from == From::staging ? "update/" : "update-from-memory/") +
                                   std::string(algorithm.name) + "/" + scene.name + "/" + std::to_string(n);
          benchmark::RegisterBenchmark(name.c_str(), time_update, algorithm, scene, n, from)
              ->UseManualTime()
              ->Iterations(256)
              ->Unit(benchmark::kMicrosecond);
        }
      }
    }
    for (const std::uint32_t n : {10U, 100U, 300U, 500U, 1250U, 2000U, 2750U, 3500U, 16000U, 64000U}) {
      for (const scenes::BroadphaseInfo& info : scenes::broadphases()) {
        if (info.name == "oracle" || n > most_in_frames(info.name)) continue;
        const std::string name = "frame/" + info.name + "/" + scene.name + "/" + std::to_string(n);
        auto* frames = benchmark::RegisterBenchmark(name.c_str(), time_frame, info.name, scene, n, n)
                           ->UseRealTime()
                           ->Unit(benchmark::kMicrosecond);
        // Bullet's axis sweep takes minutes to make this many proxies, and would do so again for every
        // estimate of the number of frames to time.
        if (n > 3500) frames->Iterations(32);
      }
    }
  }
}

}  // namespace
}  // namespace broadcl

int main(int argc, char** argv) try {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::AddCustomContext("device", broadcl::select_device().label());
  broadcl::register_all();
  broadcl::register_come_and_go();
  broadcl::register_commands();
  broadcl::register_going_back();
  broadcl::register_objects();
  broadcl::register_primitives();
  broadcl::register_proxies();
  broadcl::register_queries();
  broadcl::register_resting();
  broadcl::register_steady();
  broadcl::register_whole_list();
  broadcl::register_device_frames();
  broadcl::register_double_precision();
  broadcl::register_worlds();
  broadcl::register_two_sets();
  broadcl::register_rectangles();
  benchmark::RunSpecifiedBenchmarks();
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 2;
}
