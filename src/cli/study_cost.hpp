#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "cli/study_plan.hpp"

namespace broadcl::cli {

/// Estimates how long the runs of a study take, better the more of them have been measured. Used to show the
/// time left, not for results.
class StudyCost {
 public:
  explicit StudyCost(std::uint32_t frames) : frames_(frames) {}

  /// Records how long a run took.
  void add(const StudyRun& run, double seconds);

  /// The expected time of a run in seconds: the mean of its combination if that was measured; otherwise the
  /// guess, corrected by how far guesses were off for the same broad phase and device, or, if there are none,
  /// for all measured runs.
  [[nodiscard]] double expected(const StudyRun& run) const;

 private:
  struct Sums {
    double measured = 0;
    double guessed = 0;
  };

  [[nodiscard]] double guess(const StudyRun& run) const;

  std::uint32_t frames_;
  std::map<std::string, Sums> sums_;
};

}  // namespace broadcl::cli
