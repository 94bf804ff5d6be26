#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>

#include "cli/operating_system.hpp"
#include "cli/text.hpp"

namespace broadcl::cli {

/// How long the remaining steps will take if they take as long as those after the first one, in which kernels
/// are compiled; unknown if only the first one is done.
/// @param done At least 1.
/// @param seconds Since the first one.
[[nodiscard]] inline std::optional<double> seconds_left(std::uint64_t done, std::uint64_t steps,
                                                        double seconds) {
  if (done == 1) return std::nullopt;
  return seconds * static_cast<double>(steps - done) / static_cast<double>(done - 1);
}

/// A bar on stderr that shows how much of the work is done and how long the rest will take. It shows nothing
/// if stderr is not a terminal, and disappears at the end.
class ProgressBar {
 public:
  /// @param steps How often advance() will be called.
  explicit ProgressBar(std::uint64_t steps) : steps_(steps), visible_(is_terminal(stderr)) {}
  ~ProgressBar() {
    if (visible_ && shown_) std::fputs("\r\033[K", stderr);
  }
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  ProgressBar(ProgressBar&&) = delete;
  ProgressBar& operator=(ProgressBar&&) = delete;

  /// One more step is done.
  void advance() {
    if (++done_ == 1) first_ended_ = Clock::now();
    show(static_cast<double>(done_) / static_cast<double>(steps_),
         seconds_left(done_, steps_, seconds_since(first_ended_)));
  }

 private:
  using Clock = std::chrono::steady_clock;

  [[nodiscard]] static double seconds_since(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
  }

  /// @param share How much of the work is done, 0 to 1.
  /// @param seconds How long the rest will take, if that is known.
  void show(double share, std::optional<double> seconds) {
    constexpr double interval = 0.1;
    constexpr double width = 50;
    if (!visible_ || (shown_ && seconds_since(*shown_) < interval)) return;
    shown_ = Clock::now();
    const auto filled = static_cast<std::size_t>(share * width);
    const std::string bar = left(std::string(filled, '#'), static_cast<std::size_t>(width));
    const std::string rest = seconds ? ", " + duration_text(*seconds) + " left" : "";
    std::fprintf(stderr, "\r[%s] %3.0f %%%s\033[K", bar.c_str(), share * 100, rest.c_str());
    std::fflush(stderr);
  }

  std::uint64_t steps_;
  std::uint64_t done_ = 0;
  Clock::time_point first_ended_;
  std::optional<Clock::time_point> shown_;
  bool visible_;
};

}  // namespace broadcl::cli
