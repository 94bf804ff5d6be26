#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace broadcl {

/// Which slots changed since some time. It allocates in reserve() only.
class ChangeSet {
 public:
  bool all = false;      ///< All slots count as changed.
  bool filters = false;  ///< A filter changed.

  /// Makes room for the slots below this one.
  /// @throws std::bad_alloc
  void reserve(std::size_t slots) {
    changed_.reserve(slots);
    recycled_.reserve(slots);
    if (slots > flags_.size()) flags_.resize(slots);
  }

  void insert(std::uint32_t slot) noexcept { insert(slot, is_changed, changed_); }
  /// The object of the slot is another one.
  void recycle(std::uint32_t slot) noexcept {
    insert(slot);
    insert(slot, is_recycled, recycled_);
  }
  void insert(const ChangeSet& other) noexcept {
    for (const std::uint32_t slot : other.changed_) insert(slot);
    for (const std::uint32_t slot : other.recycled_) recycle(slot);
    all = all || other.all;
    filters = filters || other.filters;
  }
  void clear() noexcept {
    for (const std::uint32_t slot : changed_) flags_[slot] = 0;
    changed_.clear();
    recycled_.clear();
    all = filters = false;
  }

  void sort_recycled() noexcept { std::ranges::sort(recycled_); }
  [[nodiscard]] bool empty() const noexcept { return !all && changed_.empty(); }
  /// Each once.
  [[nodiscard]] std::span<const std::uint32_t> changed() const noexcept { return changed_; }
  /// Those of changed() whose object is another one, each once.
  [[nodiscard]] std::span<const std::uint32_t> recycled() const noexcept { return recycled_; }

 private:
  static constexpr std::uint8_t is_changed = 1;
  static constexpr std::uint8_t is_recycled = 2;

  void insert(std::uint32_t slot, std::uint8_t flag, std::vector<std::uint32_t>& slots) noexcept {
    if ((flags_[slot] & flag) != 0) return;
    flags_[slot] |= flag;
    slots.push_back(slot);
  }

  std::vector<std::uint32_t> changed_;
  std::vector<std::uint32_t> recycled_;
  std::vector<std::uint8_t> flags_;  // by slot
};

}  // namespace broadcl
