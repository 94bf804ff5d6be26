#include "core/exact_pairs.hpp"

namespace broadcl {

void ExactPairs::begin(Algorithm& algorithm) {
  if (!unreported_) return;
  reported_ = all(algorithm);
  unreported_.reset();
}

Delta ExactPairs::finish(Algorithm& algorithm, const Delta& found, const SlotChanges& changed, AxisSet axes,
                         std::span<const Aabb64> boxes, std::span<const double> reaches) {
  if (!reported_) unreported_ = found;
  const Touching touching = axes == 0 && reaches.empty() ? Touching{.all = true} : algorithm.touching(axes);
  const std::vector<Pair> now = pairs_apart(
      touching.pairs, threads_, [&](std::uint32_t slot) -> const Aabb64& { return boxes[slot]; },
      [&](std::uint32_t slot) { return reaches.empty() ? 0 : reaches[slot]; });
  const std::vector<Pair> before = touching.all ? apart_.all() : apart_.of(changed.slots);
  Delta delta = found;
  if (reported_) {
    const std::vector<Pair> pairs = difference(algorithm.pairs(), now);
    delta = lists_.fill([&](std::vector<Pair>& added, std::vector<Pair>& removed) {
      compare(*reported_, pairs, changed.recycled, parts_, added, removed);
    });
  } else if (!now.empty() || !before.empty()) {
    delta = lists_.fill([&](std::vector<Pair>& added, std::vector<Pair>& removed) {
      // A pair that stays with the algorithm may come together or apart, too.
      added = merge(difference(found.added, now), difference(difference(before, now), found.removed));
      removed = merge(difference(found.removed, before), difference(difference(now, before), found.added));
    });
  }
  apart_.reserve(now.size(), boxes.size());
  // Nothing below throws.
  if (touching.all) {
    apart_.clear();
  } else {
    for (const Pair& pair : before) apart_.erase(pair);
  }
  for (const Pair& pair : now) apart_.insert(pair);
  unreported_.reset();
  reported_.reset();
  lists_.commit();
  return delta;
}

std::vector<Pair> ExactPairs::all(Algorithm& algorithm) const {
  if (reported_) return *reported_;
  std::vector<Pair> pairs = algorithm.pairs();
  if (unreported_) pairs = merge(difference(pairs, unreported_->added), unreported_->removed);
  if (apart_.size() > 0) subtract(pairs, apart_.all());
  return pairs;
}

void ExactPairs::shrink() {
  apart_.shrink();
  // Nothing below throws.
  lists_.clear();
  parts_.free_scratch();
}

}  // namespace broadcl
