#include "benchmarks.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>

#include "frame_times.hpp"
#include "opencl/context.hpp"
// After "opencl/api.hpp", which chooses the version of OpenCL.
#include <broadcl/opencl.hpp>

namespace broadcl {
namespace {

enum class Variant { host, device, apart };
constexpr std::array variant_names{"host", "device", "apart"};

/// Worlds one after the other, in the unit cube or each in a cube of its own.
class Worlds {
 public:
  Worlds(std::uint32_t count, std::uint32_t boxes, bool apart)
      : edge_(static_cast<std::uint32_t>(std::ceil(std::cbrt(count)))), apart_(apart) {
    for (std::uint32_t world = 0; world < count; ++world) {
      worlds_.emplace_back(boxes, scenes::MovingBoxes::Sizes::uniform, world + 1);
    }
    place();
  }

  void advance() {
    for (scenes::MovingBoxes& world : worlds_) world.advance();
    place();
  }

  [[nodiscard]] std::span<const Aabb> boxes() const noexcept { return boxes_; }
  [[nodiscard]] std::vector<Filter> filters() const {
    std::vector<Filter> filters;
    for (std::uint32_t world = 0; world < worlds_.size(); ++world) {
      filters.resize(filters.size() + worlds_[world].boxes().size(), {.world = world});
    }
    return filters;
  }

 private:
  void place() {
    boxes_.clear();
    for (std::uint32_t world = 0; world < worlds_.size(); ++world) {
      const std::array cell{world % edge_, world / edge_ % edge_, world / edge_ / edge_};
      for (Aabb box : worlds_[world].boxes()) {
        for (std::size_t axis = 0; apart_ && axis < 3; ++axis) {
          const float offset = 2 * static_cast<float>(cell[axis]);
          box.lower[axis] += offset;
          box.upper[axis] += offset;
        }
        boxes_.push_back(box);
      }
    }
  }

  std::uint32_t edge_;  // cells along an axis, if they are apart
  bool apart_;
  std::vector<scenes::MovingBoxes> worlds_;
  std::vector<Aabb> boxes_;
};

void time_on_host(benchmark::State& state, const AlgorithmInfo& algorithm, Worlds worlds, bool apart) {
  BroadPhase broad_phase({.algorithm = std::string(algorithm.name)});
  const std::vector<Filter> filters = worlds.filters();
  for (std::size_t k = 0; k < filters.size(); ++k) {
    broad_phase.add(worlds.boxes()[k], apart ? Filter() : filters[k]);
  }
  (void)broad_phase.update();
  const auto advance = [&] {
    worlds.advance();
    for (std::uint32_t id = 0; id < filters.size(); ++id) broad_phase.move(id, worlds.boxes()[id]);
  };
  const auto update = [&] {
    const Delta delta = broad_phase.update();
    return delta.added.size() + delta.removed.size();
  };
  warm_up(advance, update);
  FrameTimes frames(state);
  for ([[maybe_unused]] auto _ : state) {
    advance();
    frames.time(update);
  }
  frames.report();
}

void time_on_device(benchmark::State& state, const AlgorithmInfo& algorithm, Worlds worlds) {
  const opencl::Context context(select_device(), false);
  const cl::CommandQueue& queue = context.queue();
  DeviceBroadPhase broad_phase(queue(), {.algorithm = std::string(algorithm.name)});
  const std::vector<Filter> filters = worlds.filters();
  const cl::Buffer boxes = context.buffer(filters.size() * sizeof(Aabb));
  const cl::Buffer device_filters = context.buffer(filters.size() * sizeof(Filter));
  queue.enqueueWriteBuffer(device_filters, CL_TRUE, 0, filters.size() * sizeof(Filter), filters.data());
  const auto update = [&] {
    const DeviceBroadPhase::Result result = broad_phase.update(
        {.buffer = boxes(), .count = filters.size(), .filters = device_filters(), .worlds = true});
    queue.finish();
    return result.added.count + result.removed.count;
  };
  const auto write = [&] {
    queue.enqueueWriteBuffer(boxes, CL_TRUE, 0, worlds.boxes().size_bytes(), worlds.boxes().data());
  };
  write();
  (void)update();
  FrameTimes frames(state);
  for ([[maybe_unused]] auto _ : state) {
    worlds.advance();
    write();
    frames.time(update);
  }
  frames.report();
}

void time_worlds(benchmark::State& state, const AlgorithmInfo& algorithm, Variant variant,
                 std::uint32_t count, std::uint32_t boxes) {
  Worlds worlds(count, boxes, variant == Variant::apart);
  if (variant == Variant::device) return time_on_device(state, algorithm, std::move(worlds));
  time_on_host(state, algorithm, std::move(worlds), variant == Variant::apart);
}

}  // namespace

/// Benchmarks of many worlds in the same space, in each of which cubes of one size move:
///
///   worlds/ALGORITHM/host/COUNTxN     BroadPhase::update(), as in update/
///   worlds/ALGORITHM/device/COUNTxN   DeviceBroadPhase::update(), as in update-device/
///   worlds/ALGORITHM/apart/COUNTxN    as host, but all in one world, in which they are moved apart
///
/// COUNT worlds of N boxes each. The last one shows the cost of having the worlds in the same space.
void register_worlds() {
  struct Size {
    std::uint32_t worlds, boxes;
  };
  for (const auto [count, boxes] :
       {Size{64, 64}, Size{16, 1024}, Size{4096, 64}, Size{1024, 256}, Size{16384, 32}}) {
    for (const AlgorithmInfo& algorithm : algorithms()) {
      if (!algorithm.on_device || algorithm.name == "gpu-bf") continue;
      if (algorithm.name == "brute-force" && count * boxes > 16384) continue;  // it tests all pairs
      for (const Variant variant : {Variant::host, Variant::device, Variant::apart}) {
        const std::string name = "worlds/" + std::string(algorithm.name) + "/" +
                                 variant_names.at(static_cast<std::size_t>(variant)) + "/" +
                                 std::to_string(count) + "x" + std::to_string(boxes);
        benchmark::RegisterBenchmark(name.c_str(), time_worlds, algorithm, variant, count, boxes)
            ->UseManualTime()
            ->Iterations(256)
            ->Unit(benchmark::kMicrosecond);
      }
    }
  }
}

}  // namespace broadcl
