#pragma once

#include <chrono>
#include <cstddef>
#include <deque>
#include <span>
#include <string_view>
#include <vector>

#include <broadcl/profile.hpp>

#include "base/non_copyable.hpp"
#include "opencl/api.hpp"

namespace broadcl::opencl {

/// Records the stages of an update: wall-clock times always, device times from events on request. The device
/// time of a stage is that of all its commands together.
class Profiler {
 public:
  explicit Profiler(bool device_times) : device_times_(device_times) {}

  /// Measures the wall clock of a stage from its construction to its destruction. Scopes may nest and
  /// overlap; stages are in the order in which scopes were made.
  class Scope : NonCopyable {
   public:
    Scope(Profiler& profiler, std::string_view name);
    ~Scope();

    /// Where to store the event of the stage's next command; null if device times are not wanted.
    /// @throws std::bad_alloc
    [[nodiscard]] cl::Event* event();

   private:
    Profiler& profiler_;
    std::size_t stage_;
    std::chrono::steady_clock::time_point start_;
  };

  /// Forgets the stages of the last update and starts the clock of this one. No scope may be open.
  void begin();
  /// Waits for the commands whose device times are wanted, and reads these, once per update.
  /// @throws cl::Error
  void resolve();
  [[nodiscard]] std::span<const Stage> stages() const noexcept { return stages_; }

 private:
  bool device_times_;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  std::vector<Stage> stages_;
  struct Command {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    std::size_t stage;
    cl::Event event;  // null if it was not enqueued
  };
  std::deque<Command> commands_;  // they never move
};

/// Where to store the event of a stage's next command; null if there is no stage.
[[nodiscard]] inline cl::Event* event_of(Profiler::Scope* stage) {
  return stage != nullptr ? stage->event() : nullptr;
}

}  // namespace broadcl::opencl
