#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "cli/study_plan.hpp"

namespace broadcl::cli {

/// How long the runs of a study take: guessed at first, and the better the more of them were measured. For
/// telling the time left, not for results.
class StudyCost {
 public:
  explicit StudyCost(std::uint32_t frames) : frames_(frames) {}

  /// A run took so long.
  void add(const StudyRun& run, double seconds);

  /// What a run takes, in seconds: the mean of its combination where that was measured; else the guess,
  /// corrected by how far it was off for the same broad phase and device, else for all that was measured.
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
