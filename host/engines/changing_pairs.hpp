#pragma once

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
  [[nodiscard]] std::size_t size() const noexcept { return size_; }

  /// @throws std::bad_alloc
  [[nodiscard]] const std::vector<Pair>& all() {
    if (!changed_.empty()) rewrite();
    return pairs_;
  }

  /// Exchanges the whole list for another one.
  void swap(std::vector<Pair>& pairs) noexcept {
    pairs_.swap(pairs);
    size_ = pairs_.size();
    changed_.clear();
  }

  /// Frees memory that is only needed to change the list.
  void free_scratch() noexcept { free_lists(rewritten_); }

  /// Frees all memory beyond that of the list.
  /// @throws std::bad_alloc
  void shrink() {
    (void)all();
    free_scratch();
    pairs_.shrink_to_fit();
    changed_.shrink_to_fit();
  }

  /// @param added,removed In canonical order. A pair in both stays.
  /// @throws std::bad_alloc Then nothing has changed.
  void change(std::span<const Pair> added, std::span<const Pair> removed) {
    std::vector<Pair> changed = symmetric_difference(changed_, symmetric_difference(added, removed));
    const std::size_t size = size_ + added.size() - removed.size();
    const bool rewrites = changed.size() > pairs_.size() / 64;
    if (rewrites) rewritten_.reserve(size);
    changed_.swap(changed);
    size_ = size;
    if (rewrites) rewrite();
  }

 private:
  void rewrite() {
    rewritten_.clear();
    rewritten_.reserve(size_);
    walk(pairs_, changed_, append_to(rewritten_), append_to(rewritten_), leave_out);
    swap(rewritten_);
  }

  std::vector<Pair> pairs_;
  std::vector<Pair> changed_;  // since then: those that were added to the list, or removed from it
  std::size_t size_ = 0;
  std::vector<Pair> rewritten_;  // memory for the next list
};

}  // namespace broadcl
