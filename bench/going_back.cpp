#include "benchmarks.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>

#include "scenes/generators.hpp"

namespace broadcl {
namespace {

using scenes::MovingBoxes;

/// The times of one of several things that are done in turn.
class Times {
 public:
  template <class Function>
  void time(const Function& function) {
    const auto start = std::chrono::steady_clock::now();
    function();
    seconds_.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  [[nodiscard]] double median_us() {
    std::ranges::nth_element(seconds_, seconds_.begin() + static_cast<std::ptrdiff_t>(seconds_.size() / 2));
    return seconds_[seconds_.size() / 2] * 1e6;
  }
  [[nodiscard]] double last() const { return seconds_.back(); }

 private:
  std::vector<double> seconds_;
};

void time_going_back(benchmark::State& state, const std::string& algorithm, std::uint32_t n,
                     std::uint32_t differ) {
  constexpr int frames_back = 8;
  MovingBoxes motion(n, MovingBoxes::Sizes::uniform);
  std::array<std::vector<Aabb>, 2> boxes;
  std::array<std::vector<Aabb>, 2> of_ids;
  boxes[0].assign(motion.boxes().begin(), motion.boxes().end());
  for (int k = 0; k < frames_back; ++k) motion.advance();
  boxes[1] = boxes[0];
  std::vector<std::uint32_t> ids(differ);
  for (std::uint32_t k = 0; k < differ; ++k) {
    ids[k] = static_cast<std::uint32_t>(std::uint64_t{k} * n / differ);
    boxes[1][ids[k]] = motion.boxes()[ids[k]];
    for (std::size_t side = 0; side < 2; ++side) of_ids[side].push_back(boxes[side][ids[k]]);
  }

  BroadPhase moved({.algorithm = algorithm});
  BroadPhase restored({.algorithm = algorithm});
  std::vector<State> states;
  for (BroadPhase* broad_phase : {&moved, &restored}) (void)broad_phase->add(BoxView(boxes[0]));
  for (std::size_t side = 0; side < 2; ++side) {
    for (BroadPhase* broad_phase : {&moved, &restored}) {
      broad_phase->move(ids, BoxView(of_ids[side]));
      (void)broad_phase->update();
    }
    states.push_back(restored.save());
  }
  std::vector<std::byte> copy(boxes[0].size() * sizeof(Aabb) + n);
  const std::vector<std::byte> live(n);

  Times restore;
  Times move;
  Times save;
  Times copying;
  std::size_t frame = 0;
  const auto go_back = [&] {
    const std::size_t side = frame++ % 2;
    Delta delta;
    Delta expected;
    restore.time([&] { delta = restored.restore(states[side]); });
    move.time([&] {
      moved.move(ids, BoxView(of_ids[side]));
      expected = moved.update();
    });
    if (!std::ranges::equal(delta.added, expected.added)) state.SkipWithError("the changes differ");
    State saved = states[side];
    save.time([&] { saved = restored.save(); });
    copying.time([&] {
      std::memcpy(copy.data(), boxes[side].data(), boxes[side].size() * sizeof(Aabb));
      std::memcpy(copy.data() + boxes[side].size() * sizeof(Aabb), live.data(), n);
      benchmark::DoNotOptimize(copy.data());
    });
  };
  constexpr int first_frames = 8;  // until memory has grown
  for (int k = 0; k < first_frames; ++k) go_back();
  restore = move = save = copying = Times();
  for ([[maybe_unused]] auto _ : state) {
    go_back();
    state.SetIterationTime(restore.last());
  }
  const double restore_us = restore.median_us();
  const double move_us = move.median_us();
  state.counters["restore_us"] = restore_us;
  state.counters["move_us"] = move_us;
  state.counters["restore_per_move"] = restore_us / move_us;
  state.counters["save_us"] = save.median_us();
  state.counters["memcpy_us"] = copying.median_us();
}

}  // namespace

/// Benchmarks of restore() and save(): back and forth between two states, whose boxes are eight frames apart.
///
///   going-back/ALGORITHM/N/DIFFER   restore(), and in turn with it move() of the boxes that differ and
///                                   update(); save(), and memcpy() of as many bytes to memory that is there
void register_going_back() {
  for (const char* algorithm : {"auto", "sweep-and-prune", "tiles"}) {
    for (const auto& [n, differ] : {std::array{800U, 800U}, std::array{10'000U, 10'000U},
                                    std::array{100'000U, 100'000U}, std::array{100'000U, 1'000U}}) {
      const std::string row =
          std::string("going-back/") + algorithm + "/" + std::to_string(n) + "/" + std::to_string(differ);
      benchmark::RegisterBenchmark(row.c_str(), time_going_back, algorithm, n, differ)
          ->UseManualTime()
          ->Iterations(n <= 1000 ? 2000 : 200)
          ->Unit(benchmark::kMicrosecond);
    }
  }
}

}  // namespace broadcl
