#pragma once

#include <chrono>
#include <span>
#include <string_view>
#include <vector>

#include <broadcl/profile.hpp>

namespace broadcl::mpi {

/// The stages of an update, by the host's clock.
class Stages {
 public:
  /// @throws std::bad_alloc
  void begin() {
    stages_.clear();
    stages_.reserve(most);
    update_start_ = stage_start_ = Clock::now();
  }
  void end(std::string_view name) noexcept {
    const Clock::time_point now = Clock::now();
    const std::chrono::duration<double> before = stage_start_ - update_start_;
    const std::chrono::duration<double> taken = now - stage_start_;
    if (stages_.size() < stages_.capacity()) {
      stages_.push_back({.name = name,
                         .host_start = before.count(),
                         .host_seconds = taken.count(),
                         .device_start = 0,
                         .device_seconds = 0});
    }
    stage_start_ = now;
  }
  /// Appends the stages of this rank's own search, and then these.
  /// @throws std::bad_alloc
  void append_to(std::vector<Stage>& profile, std::span<const Stage> own) const {
    profile.insert(profile.end(), own.begin(), own.end());
    profile.insert(profile.end(), stages_.begin(), stages_.end());
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::size_t most = 16;

  std::vector<Stage> stages_;
  Clock::time_point update_start_, stage_start_;
};

}  // namespace broadcl::mpi
