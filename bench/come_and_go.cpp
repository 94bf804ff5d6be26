#include "benchmarks.hpp"

#include <cstddef>
#include <cstdint>
#include <string>

#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>

#include "frame_times.hpp"
#include "scenes/generators.hpp"

namespace broadcl {
namespace {

using scenes::MovingBoxes;

/// Which filters are not the default one.
enum class Filters { none, of_one, of_comers };

void time_come_and_go(benchmark::State& state, const std::string& algorithm, std::uint32_t n,
                      Filters filters) {
  BroadPhase broad_phase({.algorithm = algorithm});
  const MovingBoxes boxes(n, MovingBoxes::Sizes::uniform);
  for (const Aabb& box : boxes.boxes()) broad_phase.add(box);
  if (filters != Filters::none) broad_phase.set_filter(0, {.group = 2, .mask = ~2U});
  std::uint32_t frame = 0;
  const auto update = [&]() -> std::size_t {
    const std::uint32_t id = ++frame * 7919 % n;
    broad_phase.remove(id);
    broad_phase.add(boxes.boxes()[id],
                    filters == Filters::of_comers ? Filter{.group = 1U << frame % 8} : Filter());
    const Delta delta = broad_phase.update();
    return delta.added.size() + delta.removed.size();
  };
  constexpr int first_frames = 8;  // until memory has grown
  for (int k = 0; k < first_frames; ++k) (void)update();
  FrameTimes frames(state);
  for ([[maybe_unused]] auto _ : state) frames.time(update);
  frames.report();
}

}  // namespace

/// Benchmarks of a world at rest, in which one object is replaced by another one per frame.
///
///   come-and-go/ALGORITHM/N            remove(), add() and update(); all objects have the default filter
///   come-and-go/ALGORITHM/N/of-one     the same with another filter for one of those at rest
///   come-and-go/ALGORITHM/N/of-comers  and the object that comes has another filter each time
void register_come_and_go() {
  for (const char* algorithm : {"sweep-and-prune", "tiles", "brute-force"}) {
    for (const std::uint32_t n : {10'000U, 100'000U, 1'000'000U}) {
      const std::string row = std::string("come-and-go/") + algorithm + "/" + std::to_string(n);
      const auto add = [&](const std::string& name, Filters filters) {
        benchmark::RegisterBenchmark(name.c_str(), time_come_and_go, algorithm, n, filters)
            ->UseManualTime()
            ->Iterations(256)
            ->Unit(benchmark::kMicrosecond);
      };
      add(row, Filters::none);
      add(row + "/of-one", Filters::of_one);
      add(row + "/of-comers", Filters::of_comers);
    }
  }
}

}  // namespace broadcl
