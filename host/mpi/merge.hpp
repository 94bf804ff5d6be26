#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <broadcl/mpi.hpp>

#include "mpi/workers.hpp"

namespace broadcl::mpi {

/// Merges lists of pairs, most of which are sorted already, into canonical order. Several lists may be merged
/// together: do the first step of all of them, whose tasks may run at the same time, then the second step.
class Merge {
 public:
  /// Begins a new list. The input of the last one is no longer used.
  void clear() noexcept;
  /// @param pairs Sorted, and greater than all sorted pairs that were given before.
  void take_sorted(std::span<const MpiPair> pairs);
  /// @param pairs In any order.
  void take(std::span<const MpiPair> pairs);
  /// Number of pairs that were given.
  [[nodiscard]] std::size_t size() const noexcept { return sorted_count_ + others_count_; }

  // The first step: unsorted pairs are sorted, in runs.

  /// @returns The number of tasks.
  std::size_t begin_sort();
  void sort(std::size_t task);

  // The second step: all are merged into one list.

  /// @param memory For the list; grows if necessary.
  /// @returns The number of tasks.
  std::size_t begin_merge(std::vector<MpiPair>& memory);
  void merge(std::size_t task, std::span<MpiPair> list) const;

 private:
  struct Sorted {
    std::span<const MpiPair> pairs;
    std::size_t before;  // pairs in order before them
  };
  struct Run {
    std::span<const MpiPair> unsorted;
    std::size_t begin;  // of others_
  };

  void divide();
  [[nodiscard]] std::span<const MpiPair> run(std::size_t k) const {
    return std::span(others_).subspan(runs_[k].begin, runs_[k].unsorted.size());
  }
  [[nodiscard]] std::span<const MpiPair> part(std::size_t task, std::span<const MpiPair> pairs) const;

  std::vector<Sorted> sorted_;
  std::size_t sorted_count_ = 0;
  std::vector<Run> runs_;
  std::size_t others_count_ = 0;
  std::vector<MpiPair> others_;
  std::vector<MpiPair> cuts_;  // which divide the list into parts, a task each
};

}  // namespace broadcl::mpi
