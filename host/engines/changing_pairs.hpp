#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/pair.hpp>

#include "base/free_lists.hpp"
#include "base/pair_lists.hpp"

namespace broadcl {

/// A long list of pairs, in canonical order, of which few change at a time. Recent changes are kept apart,
/// so that most of them do not rewrite the list.
class ChangingPairs {
 public:
  [[nodiscard]] std::size_t size() const noexcept { return pairs_.size() + added_.size() - removed_.size(); }

  /// @throws std::bad_alloc
  [[nodiscard]] const std::vector<Pair>& all() {
    if (!added_.empty() || !removed_.empty()) rewrite();
    return pairs_;
  }

  /// Exchanges the whole list for another one.
  void swap(std::vector<Pair>& pairs) noexcept {
    pairs_.swap(pairs);
    added_.clear();
    removed_.clear();
  }

  /// Frees memory that is only needed to change the list.
  void free_scratch() noexcept { free_lists(rewritten_); }

  /// Frees all memory beyond that of the list.
  /// @throws std::bad_alloc
  void shrink() {
    (void)all();
    free_scratch();
    for (std::vector<Pair>* list : {&pairs_, &added_, &removed_}) list->shrink_to_fit();
  }

  /// @param added,removed In canonical order. A pair in both stays.
  /// @throws std::bad_alloc Then nothing has changed.
  void change(std::span<const Pair> added, std::span<const Pair> removed) {
    const std::vector<Pair> come = difference(added, removed);
    const std::vector<Pair> gone = difference(removed, added);
    std::vector<Pair> all_added = merge(difference(added_, gone), difference(come, removed_));
    std::vector<Pair> all_removed = merge(difference(removed_, come), difference(gone, added_));
    const std::size_t most = pairs_.size() / 64;
    if (all_added.size() + all_removed.size() > most) {
      rewritten_.reserve(pairs_.size() + all_added.size());
    }
    added_.swap(all_added);
    removed_.swap(all_removed);
    if (added_.size() + removed_.size() > most) rewrite();
  }

 private:
  void rewrite() {
    rewritten_.clear();
    rewritten_.reserve(pairs_.size() + added_.size());
    auto rest = pairs_.begin();
    auto come = added_.begin();
    auto gone = removed_.begin();
    while (come != added_.end() || gone != removed_.end()) {
      const bool comes = gone == removed_.end() || (come != added_.end() && *come < *gone);
      const auto at = std::lower_bound(rest, pairs_.end(), comes ? *come : *gone);
      rewritten_.insert(rewritten_.end(), rest, at);
      rest = at;
      if (comes) {
        rewritten_.push_back(*come++);
      } else {
        ++rest;
        ++gone;
      }
    }
    rewritten_.insert(rewritten_.end(), rest, pairs_.end());
    swap(rewritten_);
  }

  std::vector<Pair> pairs_;
  std::vector<Pair> added_, removed_;  // since then
  std::vector<Pair> rewritten_;        // memory for the next list
};

}  // namespace broadcl
