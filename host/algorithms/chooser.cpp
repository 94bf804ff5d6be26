#include "algorithms/chooser.hpp"

#include <algorithm>
#include <bit>

namespace broadcl {
namespace {

constexpr double clearly_less = 0.9;     // than the other one's cost is reason enough to change
constexpr std::size_t trial_frames = 3;  // the first is not counted
constexpr std::size_t longest_interval = 1024;
/// Frames to wait for a frame of a trial, for each time that it takes longer by, as a multiple of the
/// other's: a trial loses a twentieth at most.
constexpr double patience = 20;

}  // namespace

double Work::tests() const noexcept {
  return static_cast<double>(slots) * static_cast<double>(changed) * (all ? 0.5 : 1);
}

double CostModel::seconds(const Work& work) const noexcept {
  return frame + slot * static_cast<double>(work.slots) + change * static_cast<double>(work.changed) +
         test * work.tests();
}

void Chooser::Costs::add(double cost) noexcept {
  last_[count_++ % last_.size()] = cost;
}

std::optional<double> Chooser::Costs::typical() const noexcept {
  const std::size_t n = std::min(count_, last_.size());
  if (n == 0) return std::nullopt;
  std::array<double, 3> sorted = last_;
  std::sort(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(n));
  return sorted[(n - 1) / 2];
}

/// Where nothing was measured in this situation, what was elsewhere stands for it, and what the other one
/// cost, which tells how fast the device is.
double Chooser::expected(std::size_t candidate, const Situation& situation, const Work& work) const {
  std::optional<double> cost = situation.costs[candidate].typical();
  for (const std::size_t either : {candidate, 1 - candidate}) {
    if (!cost) cost = anywhere_[either];
  }
  return models_[candidate].seconds(work) * cost.value_or(1);
}

std::optional<std::size_t> Chooser::hopeless_one(const Work& work) const {
  for (const std::size_t candidate : {0U, 1U}) {
    if (models_[candidate].seconds(work) > hopeless * models_[1 - candidate].seconds(work)) return candidate;
  }
  return std::nullopt;
}

std::size_t Chooser::choose(const Work& work) {
  work_ = work;
  situation_ = &situations_[{std::bit_width(work.slots), work.all ? 0 : std::bit_width(work.changed)}];
  Situation& s = *situation_;
  if (const auto never = hopeless_one(work)) return chosen_ = 1 - *never;
  if (s.trial > 0) return chosen_ = 1 - s.best;
  if (expected(1 - s.best, s, work) < clearly_less * expected(s.best, s, work)) s.best = 1 - s.best;
  return chosen_ = s.best;
}

void Chooser::learn(double seconds) {
  if (situation_ == nullptr) return;
  Situation& s = *situation_;
  const bool too_dear = s.trial > 0 && seconds > hopeless * expected(s.best, s, work_);
  // The first frame after a change may have to build, to sort, or to allocate.
  if (s.asked == chosen_ || too_dear) {
    s.costs[chosen_].add(seconds / models_[chosen_].seconds(work_));
    anywhere_[chosen_] = s.costs[chosen_].typical();
  }
  s.asked = chosen_;
  if (hopeless_one(work_)) return;
  if (s.trial > 0) {
    s.trial = too_dear ? 0 : s.trial - 1;
    return;
  }
  // A trial ends with a frame that is too dear, and such it may be where only the models were asked.
  const double ratio = expected(1 - s.best, s, work_) / expected(s.best, s, work_);
  const bool may_end_at_once = ratio > hopeless || !s.costs[1 - s.best].typical();
  const double frames = may_end_at_once ? 1 : trial_frames;
  const double wait = std::max(static_cast<double>(s.interval), patience * frames * (ratio - 1));
  if (static_cast<double>(++s.since) < wait) return;
  s.since = 0;
  s.interval = std::min(2 * s.interval, longest_interval);
  s.trial = trial_frames;
  s.costs[1 - s.best].clear();
}

}  // namespace broadcl
