// How much the frames of one object differ, all boxes moving, from boxes in ordinary memory.
//
// steady/ALGORITHM/THREADS/SCENE/N
//   2,000 frames after 32: the median, and the p95, the p99.5 and the longest as multiples of it. CPU time of
//   the process for an algorithm on the host with one or two threads, otherwise wall time.
// opening/auto/SCENE/N
//   From the fifth frame until 32 frames after `auto` has changed to a GPU: the median on the host, and as
//   multiples of it the longest frame there, and the longer of the two in which it changed; at last the
//   median on the GPU. Wall time; needs a GPU.
#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <span>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>

#include "benchmarks.hpp"
#include "frame_times.hpp"
#include "scenes/generators.hpp"

namespace broadcl {
namespace {

using scenes::MovingBoxes;

double wall_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Of all threads of the process.
double cpu_seconds() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

double time_frame(BroadPhase& broad_phase, MovingBoxes& boxes, double (*seconds)()) {
  boxes.advance();
  const double start = seconds();
  (void)broad_phase.update(boxes.boxes());
  return seconds() - start;
}

double quantile(std::vector<double> times, double share) {
  const auto at = times.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(times.size() - 1));
  std::nth_element(times.begin(), at, times.end());
  return *at;
}

double longest(std::span<const double> times) {
  return *std::max_element(times.begin(), times.end());
}

void time_steady(benchmark::State& state, const std::string& algorithm, std::size_t threads,
                 const Scene& scene, std::uint32_t n) {
  const bool by_cpu = algorithm == "sweep-and-prune" && threads != 0;
  BroadPhase broad_phase({.algorithm = algorithm, .threads = threads});
  MovingBoxes boxes(n, scene.sizes);
  warm_up([] {}, [&] { return time_frame(broad_phase, boxes, wall_seconds); });
  for (int frame = 0; frame < 32; ++frame) (void)time_frame(broad_phase, boxes, wall_seconds);
  std::vector<double> times;
  for ([[maybe_unused]] auto _ : state) {
    times.push_back(time_frame(broad_phase, boxes, by_cpu ? cpu_seconds : wall_seconds));
    state.SetIterationTime(times.back());
  }
  const double median = quantile(times, 0.5);
  state.counters["median_us"] = median * 1e6;
  state.counters["p95"] = quantile(times, 0.95) / median;
  state.counters["p99.5"] = quantile(times, 0.995) / median;
  state.counters["longest"] = longest(times) / median;
}

void time_opening(benchmark::State& state, const Scene& scene, std::uint32_t n) {
  constexpr int first_frames = 4;
  for ([[maybe_unused]] auto _ : state) {
    BroadPhase broad_phase;
    MovingBoxes boxes(n, scene.sizes);
    for (int frame = 0; frame < first_frames; ++frame) (void)time_frame(broad_phase, boxes, wall_seconds);
    std::vector<double> on_host;
    const double give_up = wall_seconds() + 60;
    while (!broad_phase.device() && wall_seconds() < give_up)
      on_host.push_back(time_frame(broad_phase, boxes, wall_seconds));
    if (!broad_phase.device() || on_host.size() < 2)
      return state.SkipWithError("auto did not change from the host to a GPU");
    const double last = on_host.back();  // at its end, the boxes and pairs were handed over
    on_host.pop_back();
    const double first = time_frame(broad_phase, boxes, wall_seconds);
    std::vector<double> on_gpu(32);
    for (double& seconds : on_gpu) seconds = time_frame(broad_phase, boxes, wall_seconds);
    const double median = quantile(on_host, 0.5);
    state.SetIterationTime(median);
    state.counters["median_us"] = median * 1e6;
    state.counters["longest"] = longest(on_host) / median;
    state.counters["change"] = std::max(last, first) / median;
    state.counters["gpu_us"] = quantile(on_gpu, 0.5) * 1e6;
    state.counters["frames"] = static_cast<double>(on_host.size());
  }
}

void add_steady(const std::string& algorithm, std::size_t threads, const Scene& scene, std::uint32_t n) {
  const std::string name = "steady/" + algorithm + "/" + (threads == 0 ? "all" : std::to_string(threads)) +
                           "/" + scene.name + "/" + std::to_string(n);
  benchmark::RegisterBenchmark(name.c_str(), time_steady, algorithm, threads, scene, n)
      ->UseManualTime()
      ->Iterations(2000)
      ->Unit(benchmark::kMicrosecond);
}

}  // namespace

void register_steady() {
  const bool has_gpu = select_device().type != DeviceType::cpu;
  for (const Scene& scene : scene_list) {
    for (const std::uint32_t n : {3500U, 16'000U, 64'000U, 256'000U, 1'000'000U}) {
      if (n < 1'000'000) {
        for (const std::size_t threads : {1U, 2U, 0U}) add_steady("sweep-and-prune", threads, scene, n);
      }
      add_steady("tiles", 0, scene, n);
      if (!has_gpu) continue;
      add_steady("auto", 0, scene, n);
      const std::string name = "opening/auto/" + std::string(scene.name) + "/" + std::to_string(n);
      benchmark::RegisterBenchmark(name.c_str(), time_opening, scene, n)
          ->UseManualTime()
          ->Iterations(1)
          ->Unit(benchmark::kMicrosecond);
    }
  }
}

}  // namespace broadcl
