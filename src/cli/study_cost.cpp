#include "cli/study_cost.hpp"

#include <array>
#include <cmath>
#include <string_view>

namespace broadcl::cli {
namespace {

/// Milliseconds per frame: factor * objects^exponent.
struct Growth {
  std::string_view broadphase;
  double factor;
  double exponent;
};

// Orders of magnitude, measured with PoCL on two cores of a CPU.
constexpr double response_ms = 0.01;  // per object
constexpr std::array growths{
    Growth{.broadphase = "bullet-bf", .factor = 1e-5, .exponent = 2},
    Growth{.broadphase = "oracle", .factor = 1e-5, .exponent = 2},
    Growth{.broadphase = "gpu-bf", .factor = 5e-7, .exponent = 2},
    Growth{.broadphase = "bullet-sap", .factor = 1e-4, .exponent = 1.5},
};

/// The groups of runs that a run belongs to, from the most similar runs to all of them.
std::array<std::string, 3> groups_of(const StudyRun& run) {
  return {combination_of(run), run.broadphase + " " + run.device, ""};
}

}  // namespace

void StudyCost::add(const StudyRun& run, double seconds) {
  for (const std::string& group : groups_of(run)) {
    Sums& sums = sums_[group];
    sums.measured += seconds;
    sums.guessed += guess(run);
  }
}

double StudyCost::expected(const StudyRun& run) const {
  for (const std::string& group : groups_of(run)) {
    const auto found = sums_.find(group);
    if (found != sums_.end()) return guess(run) * found->second.measured / found->second.guessed;
  }
  return guess(run);
}

double StudyCost::guess(const StudyRun& run) const {
  double ms = response_ms * run.objects;
  for (const Growth& growth : growths) {
    if (growth.broadphase == run.broadphase) ms += growth.factor * std::pow(run.objects, growth.exponent);
  }
  return ms * 1e-3 * frames_;
}

}  // namespace broadcl::cli
