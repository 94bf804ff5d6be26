#include "mpi/merge.hpp"

#include <algorithm>

namespace broadcl::mpi {
namespace {

constexpr std::size_t pairs_per_run = std::size_t{1} << 12U;
/// More than one, because a sample is uneven.
constexpr std::size_t samples_per_cut = 8;
constexpr std::size_t others_per_sample = 256;
constexpr std::size_t most_samples = 4096;

}  // namespace

void Merge::clear() noexcept {
  sorted_.clear();
  sorted_count_ = 0;
  runs_.clear();
  others_count_ = 0;
}

void Merge::take_sorted(std::span<const MpiPair> pairs) {
  if (pairs.empty()) return;
  sorted_.push_back({.pairs = pairs, .before = sorted_count_});
  sorted_count_ += pairs.size();
}

void Merge::take(std::span<const MpiPair> pairs) {
  for (; !pairs.empty(); pairs = pairs.subspan(runs_.back().unsorted.size())) {
    runs_.push_back({.unsorted = pairs.first(std::min(pairs_per_run, pairs.size())), .begin = others_count_});
    others_count_ += runs_.back().unsorted.size();
  }
}

std::size_t Merge::begin_sort() {
  if (others_.size() < others_count_) others_.resize(others_count_);
  return runs_.size();
}

void Merge::sort(std::size_t task) {
  const std::span<const MpiPair> unsorted = runs_[task].unsorted;
  const std::span<MpiPair> run = std::span(others_).subspan(runs_[task].begin, unsorted.size());
  std::ranges::copy(unsorted, run.begin());
  std::ranges::sort(run);
}

std::size_t Merge::begin_merge(std::vector<MpiPair>& memory) {
  if (memory.size() < size()) memory.resize(size());
  divide();
  return cuts_.size() + 1;
}

/// Divides the list such that no part has pairs of more than one sorted list, or very many unsorted pairs.
void Merge::divide() {
  cuts_.clear();
  const std::size_t stride = std::max(others_per_sample, others_count_ / most_samples);
  for (std::size_t k = stride / 2; k < others_count_; k += stride) cuts_.push_back(others_[k]);
  std::ranges::sort(cuts_);
  std::size_t count = 0;
  for (std::size_t k = samples_per_cut; k < cuts_.size(); k += samples_per_cut) cuts_[count++] = cuts_[k];
  cuts_.resize(count);
  for (std::size_t k = 1; k < sorted_.size(); ++k) cuts_.push_back(sorted_[k].pairs.front());
  std::ranges::sort(cuts_);
}

/// The part of a task, of sorted pairs.
std::span<const MpiPair> Merge::part(std::size_t task, std::span<const MpiPair> pairs) const {
  const auto begin = task == 0 ? pairs.begin() : std::ranges::lower_bound(pairs, cuts_[task - 1]);
  const auto end =
      task == cuts_.size() ? pairs.end() : std::ranges::lower_bound(begin, pairs.end(), cuts_[task]);
  return {begin, end};
}

void Merge::merge(std::size_t task, std::span<MpiPair> list) const {
  std::size_t before = 0;
  std::span<const MpiPair> sorted;
  if (!sorted_.empty()) {
    const auto is_after = [](const MpiPair& cut, const Sorted& one) { return cut < one.pairs.front(); };
    auto one = sorted_.begin();
    if (task > 0) {
      const auto next = std::upper_bound(sorted_.begin(), sorted_.end(), cuts_[task - 1], is_after);
      if (next != sorted_.begin()) one = next - 1;
    }
    sorted = part(task, one->pairs);
    before = one->before + static_cast<std::size_t>(sorted.data() - one->pairs.data());
  }
  std::vector<MpiPair> others;
  std::size_t parts = 0;
  for (std::size_t k = 0; k < runs_.size(); ++k) {
    const std::span<const MpiPair> some = part(task, run(k));
    before += static_cast<std::size_t>(some.data() - run(k).data());
    others.insert(others.end(), some.begin(), some.end());
    if (!some.empty()) ++parts;
  }
  if (parts > 1) std::ranges::sort(others);
  std::ranges::merge(sorted, others, list.subspan(before).begin());
}

}  // namespace broadcl::mpi
