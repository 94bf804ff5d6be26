#include "benchmarks.hpp"

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>

namespace broadcl {
namespace {

/// A broad phase that has found the pairs of a few boxes.
std::unique_ptr<BroadPhase> make_object(const std::string& algorithm) {
  auto object = std::make_unique<BroadPhase>(BroadPhase::Config{.algorithm = algorithm});
  for (std::uint32_t k = 0; k < 20; ++k) {
    const auto x = static_cast<float>(k);
    object->add({{x, 0, 0}, {x + 1.5F, 1, 1}});
  }
  (void)object->update();
  return object;
}

/// Pages of this process that are in memory.
double resident_pages() {
  double addresses = 0;
  double resident = 0;
  std::ifstream("/proc/self/statm") >> addresses >> resident;
  return resident;
}

void time_objects(benchmark::State& state, const std::string& algorithm) {
  constexpr double page = 4096;
  std::vector<std::unique_ptr<BroadPhase>> objects;
  objects.push_back(make_object(algorithm));  // opens the device
  const double before = resident_pages();
  for ([[maybe_unused]] auto _ : state) objects.push_back(make_object(algorithm));
  state.counters["KiB"] =
      benchmark::Counter((resident_pages() - before) * page / 1024, benchmark::Counter::kAvgIterations);
}

}  // namespace

/// Benchmarks of many objects that exist at the same time.
///
///   objects/ALGORITHM  another object on a device that is open, and its first update; on Linux, its memory
void register_objects() {
  for (const char* algorithm : {"sweep-and-prune", "tiles", "brute-force", "gpu-bf"}) {
    benchmark::RegisterBenchmark((std::string("objects/") + algorithm).c_str(), time_objects, algorithm)
        ->Iterations(1000)
        ->Unit(benchmark::kMicrosecond);
  }
}

}  // namespace broadcl
