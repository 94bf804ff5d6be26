#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

#include "system.hpp"

namespace broadcl::cli {

/// A bar on stderr that shows how far a loop is. Shows nothing where stderr is no terminal, and is gone in
/// the end.
class ProgressBar {
 public:
  explicit ProgressBar(std::uint64_t steps) : steps_(steps), visible_(is_terminal(stderr)) {}
  ~ProgressBar() {
    if (visible_) std::fputs("\r\033[K", stderr);
  }
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  ProgressBar(ProgressBar&&) = delete;
  ProgressBar& operator=(ProgressBar&&) = delete;

  /// One step is done.
  void advance() {
    const std::uint64_t old_percent = 100 * done_ / steps_;
    const std::uint64_t percent = 100 * ++done_ / steps_;
    if (!visible_ || (percent == old_percent && done_ > 1)) return;
    const auto filled = static_cast<std::size_t>(percent / 2);
    const std::string bar = std::string(filled, '#') + std::string(50 - filled, '.');
    std::fprintf(stderr, "\r[%s] %3u %%", bar.c_str(), static_cast<unsigned>(percent));
    std::fflush(stderr);
  }

 private:
  std::uint64_t steps_;
  std::uint64_t done_ = 0;
  bool visible_;
};

}  // namespace broadcl::cli
