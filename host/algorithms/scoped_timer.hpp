#pragma once

#include <chrono>

namespace broadcl {

/// Adds the seconds of its life to a sum, which must outlive it.
class ScopedTimer {
 public:
  explicit ScopedTimer(double& sum) noexcept : sum_(sum) {}
  ~ScopedTimer() { sum_ += std::chrono::duration<double>(Clock::now() - start_).count(); }
  ScopedTimer(const ScopedTimer&) = delete;
  ScopedTimer& operator=(const ScopedTimer&) = delete;
  ScopedTimer(ScopedTimer&&) = delete;
  ScopedTimer& operator=(ScopedTimer&&) = delete;

 private:
  using Clock = std::chrono::steady_clock;
  double& sum_;
  Clock::time_point start_ = Clock::now();
};

}  // namespace broadcl
