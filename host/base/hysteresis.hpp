#pragma once

#include <algorithm>

namespace broadcl {

/// When to change from one of two ways to the other, neither of which is always better: not before staying
/// has cost as much as a change does, or they would change with every frame (see "An optimal on-line
/// algorithm for metrical task systems", Borodin, Linial and Saks, 1992).
class Hysteresis {
 public:
  /// @param excess What the present way has cost more than the other one would have; negative if it has cost
  /// less.
  /// @param cost Of a change.
  /// @returns Whether to change. Then the excess of the other way counts, from nothing on.
  [[nodiscard]] bool must_change(double excess, double cost) noexcept {
    excess_ = std::max(0.0, excess_ + excess);
    if (excess_ <= cost) return false;
    excess_ = 0;
    return true;
  }

 private:
  double excess_ = 0;
};

}  // namespace broadcl
