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
  bool all = false;      ///< All slots count as changed.
  bool filters = false;  ///< A filter changed.

  /// Reserves memory for all slots below this one.
  /// @throws std::bad_alloc
  void reserve(std::size_t slots) {
    changed_.reserve(slots);
    recycled_.reserve(slots);
    if (slots > words_.size()) words_.resize(slots);
  }

  void insert(std::uint32_t slot) noexcept {
    if (is_in(slot)) return;
    words_[slot] = epoch_ << 1U;
    changed_.push_back(slot);
  }
  /// Records that the slot now belongs to another object.
  void recycle(std::uint32_t slot) noexcept {
    insert(slot);
    if ((words_[slot] & 1U) != 0) return;
    words_[slot] |= 1U;
    recycled_.push_back(slot);
  }
  void insert(const ChangeSet& other) noexcept {
    for (const std::uint32_t slot : other.changed_) insert(slot);
    for (const std::uint32_t slot : other.recycled_) recycle(slot);
    all = all || other.all;
    filters = filters || other.filters;
  }
  void clear() noexcept {
    changed_.clear();
    recycled_.clear();
    all = filters = false;
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

 private:
  static constexpr std::uint32_t last_epoch = 0x7fffffff;

  [[nodiscard]] bool is_in(std::uint32_t slot) const noexcept { return words_[slot] >> 1U == epoch_; }

  std::vector<std::uint32_t> changed_;
  std::vector<std::uint32_t> recycled_;
  // By slot: the epoch in which it was inserted, and in the lowest bit whether it is in recycled_. So clear()
  // need not visit the slots.
  std::vector<std::uint32_t> words_;
  std::uint32_t epoch_ = 1;
};

}  // namespace broadcl
