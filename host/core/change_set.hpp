#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace broadcl {

/// The slots that changed since it was last cleared. Only reserve() allocates.
class ChangeSet {
 public:
  bool all = false;          ///< All slots count as changed.
  bool all_filters = false;  ///< All filters and exclusions count as changed.
  bool filters = false;      ///< The filter of an object changed that is not new.
  bool exclusions = false;   ///< An exclusion changed.

  /// Reserves memory for all slots below this one.
  /// @throws std::bad_alloc
  void reserve(std::size_t slots) {
    changed_.reserve(slots);
    recycled_.reserve(slots);
    refiltered_.reserve(slots);
    if (slots > words_.size()) words_.resize(slots);
  }

  void insert(std::uint32_t slot) noexcept {
    if (is_in(slot)) return;
    words_[slot] = epoch_ << flags;
    changed_.push_back(slot);
  }
  /// Records that the slot now belongs to another object.
  void recycle(std::uint32_t slot) noexcept {
    insert(slot);
    if ((words_[slot] & recycled_flag) != 0) return;
    words_[slot] |= recycled_flag;
    recycled_.push_back(slot);
  }
  /// Records that the slot has another filter now.
  void refilter(std::uint32_t slot) noexcept {
    insert(slot);
    filters = filters || (words_[slot] & recycled_flag) == 0;
    if ((words_[slot] & refiltered_flag) != 0) return;
    words_[slot] |= refiltered_flag;
    refiltered_.push_back(slot);
  }
  /// Records that no slot belongs to another object after all, though each may have another filter.
  void forget_recycled() noexcept {
    for (const std::uint32_t slot : recycled_) {
      words_[slot] &= ~recycled_flag;
      refilter(slot);
    }
    recycled_.clear();
  }
  void insert(const ChangeSet& other) noexcept {
    for (const std::uint32_t slot : other.changed_) insert(slot);
    for (const std::uint32_t slot : other.recycled_) recycle(slot);
    for (const std::uint32_t slot : other.refiltered_) refilter(slot);
    all = all || other.all;
    all_filters = all_filters || other.all_filters;
    filters = filters || other.filters;
    exclusions = exclusions || other.exclusions;
  }
  void clear() noexcept {
    changed_.clear();
    recycled_.clear();
    refiltered_.clear();
    all = all_filters = filters = exclusions = false;
    if (++epoch_ <= last_epoch) return;
    std::ranges::fill(words_, 0U);
    epoch_ = 1;
  }

  void sort_recycled() noexcept { std::ranges::sort(recycled_); }
  [[nodiscard]] bool empty() const noexcept { return !all && changed_.empty(); }
  /// Each once.
  [[nodiscard]] std::span<const std::uint32_t> changed() const noexcept { return changed_; }
  /// Those slots of changed() that now belong to another object, each once.
  [[nodiscard]] std::span<const std::uint32_t> recycled() const noexcept { return recycled_; }
  /// Those slots of changed() that have another filter now, each once.
  [[nodiscard]] std::span<const std::uint32_t> refiltered() const noexcept { return refiltered_; }

 private:
  // The lowest bits of a word.
  static constexpr unsigned flags = 2;
  static constexpr std::uint32_t recycled_flag = 1;
  static constexpr std::uint32_t refiltered_flag = 2;
  static constexpr std::uint32_t last_epoch = 0xffffffff >> flags;

  [[nodiscard]] bool is_in(std::uint32_t slot) const noexcept { return words_[slot] >> flags == epoch_; }

  std::vector<std::uint32_t> changed_;
  std::vector<std::uint32_t> recycled_;
  std::vector<std::uint32_t> refiltered_;
  // By slot: the epoch in which it was inserted, and flags that say whether it is in recycled_ and in
  // refiltered_. So clear() need not visit the slots.
  std::vector<std::uint32_t> words_;
  std::uint32_t epoch_ = 1;
};

}  // namespace broadcl
