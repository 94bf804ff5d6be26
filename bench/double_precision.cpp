#include "benchmarks.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "scenes/generators.hpp"

namespace broadcl {
namespace {

using scenes::MovingBoxes;

/// The boxes about a place where single precision would not do.
std::vector<Aabb64> far_away(std::span<const Aabb> boxes) {
  constexpr double place = 6.4e6;
  std::vector<Aabb64> far(boxes.size());
  for (std::size_t k = 0; k < far.size(); ++k) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      far[k].lower[axis] = place + static_cast<double>(boxes[k].lower[axis]);
      far[k].upper[axis] = place + static_cast<double>(boxes[k].upper[axis]);
    }
  }
  return far;
}

void time_all_pairs(benchmark::State& state, const std::string& algorithm, MovingBoxes::Sizes sizes,
                    std::uint32_t n, bool in_double) {
  const MovingBoxes motion(n, sizes);
  const std::vector<Aabb> boxes(motion.boxes().begin(), motion.boxes().end());
  const std::vector<Aabb64> far = far_away(boxes);
  const BoxView view = in_double ? BoxView(far) : BoxView(boxes);
  std::size_t pairs =
      overlapping_pairs(view, {}, {.algorithm = algorithm}).size();  // opens the device, untimed
  for ([[maybe_unused]] auto _ : state) {
    const auto start = std::chrono::steady_clock::now();
    pairs = overlapping_pairs(view, {}, {.algorithm = algorithm}).size();
    state.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  state.counters["pairs"] = static_cast<double>(pairs);
}

template <class Object>
void time_updates(benchmark::State& state, const std::string& algorithm, MovingBoxes::Sizes sizes,
                  std::uint32_t n) {
  constexpr bool in_double = std::is_same_v<Object, BroadPhase64>;
  constexpr int first_frames = 32;  // until `auto` has opened a device, and memory has grown
  MovingBoxes motion(n, sizes);
  Object object({.algorithm = algorithm});
  std::vector<double> seconds;
  std::size_t changes = 0;
  const auto update = [&] {
    const std::vector<Aabb64> far = far_away(motion.boxes());
    const BoxView view = in_double ? BoxView(far) : BoxView(motion.boxes());
    const auto start = std::chrono::steady_clock::now();
    const Delta delta = object.update(view);
    const double taken = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    changes += delta.added.size() + delta.removed.size();
    motion.advance();
    return taken;
  };
  for (int frame = 0; frame < first_frames; ++frame) (void)update();
  for ([[maybe_unused]] auto _ : state) {
    seconds.push_back(update());
    state.SetIterationTime(seconds.back());
  }
  std::ranges::nth_element(seconds, seconds.begin() + static_cast<std::ptrdiff_t>(seconds.size() / 2));
  state.counters["median_us"] = 1e6 * seconds[seconds.size() / 2];
  state.counters["changes"] = static_cast<double>(changes);
}

template <class Function>
void for_each_scene(const Function& function) {
  for (const std::string algorithm : {"sweep-and-prune", "tiles"}) {
    for (const auto& [scene, sizes] :
         {std::pair("uniform", MovingBoxes::Sizes::uniform), {"mixed", MovingBoxes::Sizes::mixed}}) {
      for (const std::uint32_t n : {3'500U, 100'000U, 1'000'000U}) function(algorithm, scene, sizes, n);
    }
  }
}

}  // namespace

/// all-pairs/ALGORITHM/SCENE/TYPE/N: overlapping_pairs() of boxes in float32, and of the same boxes in
/// float64, 6,400 km from the origin.
/// update-in-double/ALGORITHM/SCENE/TYPE/N: update(boxes) of a BroadPhase with boxes in float32, and of a
/// BroadPhase64 with the same boxes in float64, in 64 frames in which every box moves.
void register_double_precision() {
  for_each_scene(
      [](const std::string& algorithm, const std::string& scene, MovingBoxes::Sizes sizes, std::uint32_t n) {
        const std::string end = "/" + std::to_string(n);
        const std::string boxes = algorithm + "/" + scene;
        for (const bool in_double : {false, true}) {
          const std::string type = in_double ? "/float64" : "/float32";
          const std::string name = std::string("all-pairs/").append(boxes).append(type).append(end);
          benchmark::RegisterBenchmark(name.c_str(), time_all_pairs, algorithm, sizes, n, in_double)
              ->UseManualTime()
              ->Unit(benchmark::kMillisecond);
        }
        const auto add = [&](const std::string& type, const auto& time) {
          const std::string name = std::string("update-in-double/").append(boxes).append(type).append(end);
          benchmark::RegisterBenchmark(name.c_str(), time, algorithm, sizes, n)
              ->UseManualTime()
              ->Iterations(64)
              ->Unit(benchmark::kMicrosecond);
        };
        add("/float32", time_updates<BroadPhase>);
        add("/float64", time_updates<BroadPhase64>);
      });
}

}  // namespace broadcl
