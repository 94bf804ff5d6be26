#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/device.hpp>

#include "scenes/generators.hpp"

namespace broadcl {

struct Scene {
  const char* name;
  scenes::MovingBoxes::Sizes sizes;
};
inline constexpr std::array scene_list{Scene{"uniform", scenes::MovingBoxes::Sizes::uniform},
                                       Scene{"mixed", scenes::MovingBoxes::Sizes::mixed}};

/// If `auto` may open a GPU, repeats a frame while it does so, and until it knows what updates take there.
/// Other algorithms repeat it as long, because boxes drift and orders age.
template <class Advance, class Update>
void warm_up(const Advance& advance, const Update& update) {
  if (select_device().type == DeviceType::cpu) return;
  const auto start = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() - start < std::chrono::seconds(2)) {
    advance();
    (void)update();
  }
}

/// Times frames one by one, and reports the mean, the median, the p95 and the longest.
class FrameTimes {
 public:
  explicit FrameTimes(benchmark::State& state) : state_(state) {}

  /// @param count FrameTimes that are one call.
  template <class Function>
  void time(Function&& frame, std::size_t count = 1) {
    const auto start = std::chrono::steady_clock::now();
    changes_ += frame();
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
    times_.push_back(taken.count() / static_cast<double>(count));
    state_.SetIterationTime(times_.back());
  }

  void report() {
    std::sort(times_.begin(), times_.end());
    state_.counters["median_us"] = times_[times_.size() / 2] * 1e6;
    state_.counters["p95_us"] = times_[times_.size() * 95 / 100] * 1e6;
    state_.counters["max_us"] = times_.back() * 1e6;
    state_.counters["changes"] = static_cast<double>(changes_) / static_cast<double>(times_.size());
  }

 private:
  benchmark::State& state_;
  std::vector<double> times_;
  std::size_t changes_ = 0;
};

}  // namespace broadcl
