#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/pair.hpp>

#include "base/free_lists.hpp"
#include "base/pair_lists.hpp"
#include "base/parallel.hpp"

namespace broadcl {

/// Finds what changed between two lists of pairs, with several threads.
class PairComparison {
 public:
  /// @param threads At most; 0 for one per processor.
  explicit PairComparison(std::size_t threads) noexcept : threads_(threads) {}

  /// As compare() does.
  /// @throws std::bad_alloc
  void operator()(std::span<const Pair> before, std::span<const Pair> now,
                  std::span<const std::uint32_t> recycled, std::vector<Pair>& added,
                  std::vector<Pair>& removed) {
    constexpr std::size_t pairs_per_part = 2048;
    constexpr std::size_t pairs_per_thread = 4096;
    const std::span<const Pair> longer = before.size() > now.size() ? before : now;
    const std::size_t shorter = std::min(before.size(), now.size());
    const std::size_t threads = useful_threads(longer.size(), pairs_per_thread, threads_);
    // If one list is much shorter, most pairs changed, and the lists of the parts would take as much memory
    // as those that are wanted.
    if (threads == 1 || shorter < longer.size() / 4) return compare(before, now, recycled, added, removed);
    const std::size_t parts = (longer.size() + pairs_per_part - 1) / pairs_per_part;
    if (parts_.size() < parts) parts_.resize(parts);
    parallel_for(parts, threads, [&](std::size_t k, std::size_t /*thread*/) {
      const auto part_of = [&](std::span<const Pair> list) {
        const auto start = [&](std::size_t part) {
          if (part == 0) return list.begin();
          return part == parts ? list.end() : std::ranges::lower_bound(list, longer[part * pairs_per_part]);
        };
        return std::span<const Pair>(start(k), start(k + 1));
      };
      compare(part_of(before), part_of(now), recycled, parts_[k].added, parts_[k].removed);
    });
    join(parts, &Part::added, added);
    join(parts, &Part::removed, removed);
    if (added.size() + removed.size() > longer.size()) free_scratch();
  }

  /// Frees memory that is only needed to compare.
  void free_scratch() noexcept { free_lists(parts_); }

 private:
  struct alignas(cache_line) Part {
    std::vector<Pair> added, removed;
  };

  void join(std::size_t parts, std::vector<Pair> Part::*list, std::vector<Pair>& all) const {
    all.clear();
    for (std::size_t k = 0; k < parts; ++k) {
      const std::vector<Pair>& part = parts_[k].*list;
      all.insert(all.end(), part.begin(), part.end());
    }
  }

  std::size_t threads_;
  std::vector<Part> parts_;
};

}  // namespace broadcl
