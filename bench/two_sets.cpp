#include "benchmarks.hpp"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include "cli/box_file.hpp"
#include "engines/algorithm.hpp"

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
  std::vector<Aabb> first = cli::read_boxes(folder / "cloth-ball-edges.npy").as_float32();
  std::vector<Aabb> second = cli::read_boxes(folder / "cloth-ball-faces.npy").as_float32();
  if (points) second = shrunk(std::move(second));
  std::vector<Filter> filters;
  if (!as_one) {
    filters.assign(first.size(), Filter::first_set);
    filters.resize(first.size() + second.size(), Filter::second_set);
  }
  first.insert(first.end(), second.begin(), second.end());
  const auto finder = make_algorithm({.algorithm = algorithm});
  finder->reserve(first.size(), !as_one);
  const auto update = [&](const Input& input) {
    finder->begin(input);
    return finder->finish().added.size();
  };
  const auto find = [&] {
    std::ranges::copy(first, finder->boxes().begin());
    return update(
        {.boxes = finder->boxes().first(first.size()),
         .changed = {.all = true},
         .rules = {.filters = filters, .all_changed = true, .sets = !as_one, .sets_decide = !as_one}});
  };
  std::size_t pairs = find();  // memory grows here, untimed
  for ([[maybe_unused]] auto _ : state) {
    (void)update({.changed = {.all = true},
                  .rules = {.all_changed = true, .sets = !as_one}});  // so that all pairs are new
    const auto start = std::chrono::steady_clock::now();
    pairs = find();
    state.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  state.counters["pairs"] = static_cast<double>(pairs);
  state.counters["s/pair"] =
      benchmark::Counter(static_cast<double>(pairs),
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

}  // namespace

/// Benchmarks of finding all pairs of two sets at once, from boxes on the host to the list there, with a
/// device that is already open, and of one set of all these boxes:
///
///   two-sets/ALGORITHM/edges-faces, two-sets/ALGORITHM/edges-points
///   two-sets/ALGORITHM/edges-faces/as-one, two-sets/ALGORITHM/edges-points/as-one
///
/// `s/pair` is the time per pair found. Edges and faces are those of cloth-ball in the folder that
/// BROADCL_TEST_DATA names; points are boxes a tenth as large at the centres of the faces' boxes. If the
/// variable is not set, these benchmarks do not exist.
void register_two_sets() {
  const char* folder = std::getenv("BROADCL_TEST_DATA");  // NOLINT(concurrency-mt-unsafe)
  if (folder == nullptr) return;
  for (const std::string algorithm : {"sweep-and-prune", "tiles"}) {
    for (const bool points : {false, true}) {
      for (const bool as_one : {false, true}) {
        const std::string name = "two-sets/" + algorithm + (points ? "/edges-points" : "/edges-faces");
        benchmark::RegisterBenchmark((name + (as_one ? "/as-one" : "")).c_str(), time_two_sets, algorithm,
                                     std::filesystem::path(folder), points, as_one)
            ->UseManualTime()
            ->Iterations(10)
            ->Unit(benchmark::kMillisecond);
      }
    }
  }
}

}  // namespace broadcl
