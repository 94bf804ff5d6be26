#include "benchmarks.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/box_view.hpp>
#include <broadcl/broad_phase.hpp>

#include "scenes/random.hpp"

namespace broadcl {
namespace {

/// Unit squares, each of which overlaps about ten others.
std::vector<std::array<float, 4>> random_squares(std::size_t n) {
  scenes::Random random(1);
  const float side = std::sqrt(0.4F * static_cast<float>(n));
  std::vector<std::array<float, 4>> squares(n);
  for (auto& [left, bottom, right, top] : squares) {
    left = random.uniform(0, side);
    bottom = random.uniform(0, side);
    right = left + 1;
    top = bottom + 1;
  }
  return squares;
}

void time_rectangles(benchmark::State& state, const std::string& algorithm, std::size_t n, bool as_boxes) {
  const std::vector<std::array<float, 4>> squares = random_squares(n);
  std::vector<Aabb> boxes;
  boxes.reserve(n);
  for (const auto& [left, bottom, right, top] : squares) {
    boxes.push_back({{left, bottom, 0}, {right, top, 0}});
  }
  const BoxView view = as_boxes ? BoxView(boxes) : BoxView::rectangles(squares.front().data(), n);
  BroadPhase broad_phase({.algorithm = algorithm});
  const auto find = [&] {
    view.copy_to(broad_phase.map(n));
    (void)broad_phase.update();
  };
  find();  // memory grows here, untimed
  find();
  for ([[maybe_unused]] auto _ : state) find();
  state.counters["pairs"] = static_cast<double>(broad_phase.pairs().size());
}

}  // namespace

/// Benchmarks of an update of all boxes in two dimensions, from memory of the caller:
///
///   rectangles/ALGORITHM/N             given as rectangles
///   rectangles/ALGORITHM/N/as-boxes    given as boxes with z = 0
void register_rectangles() {
  for (const std::string algorithm : {"sweep-and-prune", "tiles"}) {
    for (const std::size_t n : {3'500U, 100'000U}) {
      for (const bool as_boxes : {false, true}) {
        const std::string name = "rectangles/" + algorithm + '/' + std::to_string(n);
        benchmark::RegisterBenchmark((name + (as_boxes ? "/as-boxes" : "")).c_str(), time_rectangles,
                                     algorithm, n, as_boxes)
            ->UseRealTime()
            ->Unit(benchmark::kMicrosecond);
      }
    }
  }
}

}  // namespace broadcl
