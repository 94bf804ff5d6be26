#include "benchmarks.hpp"

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>

#include "scenes/generators.hpp"

namespace broadcl {
namespace {

using scenes::MovingBoxes;

/// The numbers of the boxes, about a place where single precision would not do.
std::vector<double> far_away(const std::vector<Aabb>& boxes) {
  constexpr double place = 6.4e6;
  std::vector<double> numbers;
  numbers.reserve(6 * boxes.size());
  for (const Aabb& box : boxes) {
    for (const float bound : box.lower) numbers.push_back(place + static_cast<double>(bound));
    for (const float bound : box.upper) numbers.push_back(place + static_cast<double>(bound));
  }
  return numbers;
}

void time_all_pairs(benchmark::State& state, const std::string& algorithm, MovingBoxes::Sizes sizes,
                    std::uint32_t n, bool in_double) {
  const MovingBoxes motion(n, sizes);
  const std::vector<Aabb> boxes(motion.boxes().begin(), motion.boxes().end());
  const std::vector<double> numbers = far_away(boxes);
  const BoxView view = in_double ? BoxView::interleaved(numbers.data(), n) : BoxView(boxes);
  std::size_t pairs = overlapping_pairs(view, {.algorithm = algorithm}).size();  // opens the device, untimed
  for ([[maybe_unused]] auto _ : state) {
    const auto start = std::chrono::steady_clock::now();
    pairs = overlapping_pairs(view, {.algorithm = algorithm}).size();
    state.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  state.counters["pairs"] = static_cast<double>(pairs);
}

}  // namespace

/// all-pairs/ALGORITHM/SCENE/TYPE/N: overlapping_pairs() of boxes in float32, and of the same boxes in
/// float64, 6,400 km from the origin.
void register_double_precision() {
  for (const std::string algorithm : {"sweep-and-prune", "tiles"}) {
    for (const auto& [scene, sizes] :
         {std::pair("uniform", MovingBoxes::Sizes::uniform), {"mixed", MovingBoxes::Sizes::mixed}}) {
      for (const std::uint32_t n : {3'500U, 100'000U, 1'000'000U}) {
        for (const bool in_double : {false, true}) {
          const std::string name = "all-pairs/" + algorithm + "/" + scene +
                                   (in_double ? "/float64/" : "/float32/") + std::to_string(n);
          benchmark::RegisterBenchmark(name.c_str(), time_all_pairs, algorithm, sizes, n, in_double)
              ->UseManualTime()
              ->Unit(benchmark::kMillisecond);
        }
      }
    }
  }
}

}  // namespace broadcl
