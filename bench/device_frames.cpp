#include "benchmarks.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>

#include "frame_times.hpp"
#include "opencl/context.hpp"
// After "opencl/api.hpp", which chooses the version of OpenCL.
#include <broadcl/opencl.hpp>

namespace broadcl {
namespace {

void time_device_update(benchmark::State& state, const AlgorithmInfo& algorithm, const Scene& scene,
                        std::uint32_t n) {
  const opencl::Context context(select_device(), false);
  const cl::CommandQueue& queue = context.queue();
  DeviceBroadPhase broad_phase(queue(), {.algorithm = std::string(algorithm.name)});
  scenes::MovingBoxes boxes(n, scene.sizes);
  const std::size_t bytes = n * sizeof(Aabb);
  const cl::Buffer buffer = context.buffer(bytes);
  const auto update = [&] {
    const DeviceBroadPhase::Result result = broad_phase.update({.buffer = buffer(), .count = n});
    queue.finish();
    return result.added.count + result.removed.count;
  };
  queue.enqueueWriteBuffer(buffer, CL_TRUE, 0, bytes, boxes.boxes().data());
  (void)update();
  FrameTimes frames(state);
  for ([[maybe_unused]] auto _ : state) {
    boxes.advance();
    queue.enqueueWriteBuffer(buffer, CL_TRUE, 0, bytes, boxes.boxes().data());
    frames.time(update);
  }
  frames.report();
}

void time_enqueue(benchmark::State& state, const AlgorithmInfo& algorithm, const Scene& scene,
                  std::uint32_t n) {
  constexpr std::size_t at_once = 8;
  const opencl::Context context(select_device(), false);
  const cl::CommandQueue& queue = context.queue();
  DeviceBroadPhase broad_phase(queue(), {.algorithm = std::string(algorithm.name)});
  scenes::MovingBoxes boxes(n, scene.sizes);
  const std::size_t bytes = n * sizeof(Aabb);
  std::array<cl::Buffer, at_once> buffers;
  const auto advance = [&] {
    for (cl::Buffer& buffer : buffers) {
      boxes.advance();
      if (buffer() == nullptr) buffer = context.buffer(bytes);
      queue.enqueueWriteBuffer(buffer, CL_TRUE, 0, bytes, boxes.boxes().data());
    }
  };
  advance();
  std::size_t changes = 0;
  std::size_t pairs = 0;
  for (const cl::Buffer& buffer : buffers) {
    const DeviceBroadPhase::Result result = broad_phase.update({.buffer = buffer(), .count = n});
    changes = std::max(result.added.count, result.removed.count);
    pairs = result.pair_count;
  }
  const std::size_t capacity = changes + changes / 2 + 64;
  broad_phase.reserve(n, pairs + pairs / 4 + capacity);
  const cl::Buffer added = context.buffer(capacity * sizeof(Pair));
  const cl::Buffer removed = context.buffer(capacity * sizeof(Pair));
  std::array<std::uint32_t, 4> words{};
  const cl::Buffer counts = context.buffer(sizeof words);
  FrameTimes frames(state);
  for ([[maybe_unused]] auto _ : state) {
    advance();
    frames.time(
        [&] {
          for (const cl::Buffer& buffer : buffers) {
            broad_phase.enqueue(
                {.buffer = buffer(), .count = n},
                {.added = added(), .removed = removed(), .capacity = capacity, .counts = counts()});
          }
          queue.finish();
          return std::size_t{0};
        },
        at_once);
    queue.enqueueReadBuffer(counts, CL_TRUE, 0, sizeof words, words.data());
    if (words[3] != 0) state.SkipWithError("an update is incomplete");
  }
  frames.report();
}

}  // namespace

/// Benchmarks of boxes that are already on the device, all of which move in every frame:
///
///   update-device/ALGORITHM/SCENE/N   DeviceBroadPhase::update(), until its queue has finished
///   update-enqueue/ALGORITHM/SCENE/N  DeviceBroadPhase::enqueue(), eight frames at a time, until the queue
///                                     has finished; the time of one frame
///
/// The changes stay on the device, in canonical order. Writing the boxes of the next frames is not timed.
void register_device_frames() {
  for (const Scene& scene : scene_list) {
    for (const std::uint32_t n : {3500U, 16000U, 64000U, 256000U, 1'000'000U}) {
      for (const AlgorithmInfo& algorithm : algorithms()) {
        if (!algorithm.on_device || algorithm.name == "gpu-bf") continue;
        if (algorithm.name == "brute-force" && n > 16000) continue;  // it tests all pairs
        const std::string name =
            "update-device/" + std::string(algorithm.name) + "/" + scene.name + "/" + std::to_string(n);
        benchmark::RegisterBenchmark(name.c_str(), time_device_update, algorithm, scene, n)
            ->UseManualTime()
            ->Iterations(256)
            ->Unit(benchmark::kMicrosecond);
        benchmark::RegisterBenchmark(("update-enqueue" + name.substr(name.find('/'))).c_str(), time_enqueue,
                                     algorithm, scene, n)
            ->UseManualTime()
            ->Iterations(32)
            ->Unit(benchmark::kMicrosecond);
      }
    }
  }
}

}  // namespace broadcl
