#include "two_sets.hpp"

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>

#include "cli/npy.hpp"

namespace broadcl {
namespace {

std::vector<Aabb> shrunk(std::vector<Aabb> boxes) {
  for (Aabb& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float margin = 0.45F * (box.upper[axis] - box.lower[axis]);
      box.lower[axis] += margin;
      box.upper[axis] -= margin;
    }
  }
  return boxes;
}

void time_two_sets(benchmark::State& state, const std::string& algorithm, const std::filesystem::path& folder,
                   bool points, bool as_one) {
  const BroadPhase::Config config{.algorithm = algorithm};
  std::vector<Aabb> first = cli::read_boxes(folder / "cloth-ball-edges.npy");
  std::vector<Aabb> second = cli::read_boxes(folder / "cloth-ball-faces.npy");
  if (points) second = shrunk(std::move(second));
  if (as_one) first.insert(first.end(), second.begin(), second.end());
  std::size_t pairs = 0;
  for ([[maybe_unused]] auto _ : state) {
    pairs = (as_one ? overlapping_pairs(first, config) : overlapping_pairs(first, second, config)).size();
  }
  state.counters["pairs"] = static_cast<double>(pairs);
  state.counters["s/pair"] =
      benchmark::Counter(static_cast<double>(pairs),
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

}  // namespace

void register_two_sets() {
  const char* folder = std::getenv("BROADCL_TEST_DATA");  // NOLINT(concurrency-mt-unsafe)
  if (folder == nullptr) return;
  for (const std::string algorithm : {"sweep-and-prune", "tiles"}) {
    for (const bool points : {false, true}) {
      for (const bool as_one : {false, true}) {
        const std::string name = "two-sets/" + algorithm + (points ? "/edges-points" : "/edges-faces");
        benchmark::RegisterBenchmark((name + (as_one ? "/as-one" : "")).c_str(), time_two_sets, algorithm,
                                     std::filesystem::path(folder), points, as_one)
            ->UseRealTime()
            ->Iterations(10)
            ->Unit(benchmark::kMillisecond);
      }
    }
  }
}

}  // namespace broadcl
