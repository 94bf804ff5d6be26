#pragma once

#include <chrono>
#include <utility>

namespace broadcl::cli {

class Stopwatch {
 public:
  /// The seconds that passed since it was made or last asked.
  [[nodiscard]] double lap() {
    const Clock::time_point now = Clock::now();
    return std::chrono::duration<double>(now - std::exchange(begin_, now)).count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point begin_ = Clock::now();
};

}  // namespace broadcl::cli
