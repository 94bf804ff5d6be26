#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace broadcl {

/// A set of slots that remembers the order in which they came, and is emptied at once.
class SlotSet {
 public:
  void insert(std::uint32_t slot) {
    if (slot >= since_.size()) since_.resize(std::max<std::size_t>(slot + 1, 2 * since_.size()));
    if (since_[slot] == epoch_) return;
    since_[slot] = epoch_;
    slots_.push_back(slot);
  }
  void insert(std::span<const std::uint32_t> slots) {
    for (const std::uint32_t slot : slots) insert(slot);
  }
  void clear() {
    slots_.clear();
    if (++epoch_ != 0) return;
    std::fill(since_.begin(), since_.end(), 0);
    epoch_ = 1;
  }
  [[nodiscard]] bool contains(std::uint32_t slot) const {
    return slot < since_.size() && since_[slot] == epoch_;
  }
  [[nodiscard]] const std::vector<std::uint32_t>& slots() const noexcept { return slots_; }
  void sort() { std::sort(slots_.begin(), slots_.end()); }

 private:
  std::vector<std::uint32_t> slots_;
  std::vector<std::uint32_t> since_;  // the epoch in which a slot came
  std::uint32_t epoch_ = 1;
};

/// What changed of the objects in some time.
struct ChangeSet {
  SlotSet changed;
  SlotSet renewed;       // of changed, those whose object is another one
  bool all = false;      // all changed
  bool filters = false;  // a filter changed

  [[nodiscard]] bool empty() const noexcept { return !all && changed.slots().empty(); }
  void clear() {
    changed.clear();
    renewed.clear();
    all = filters = false;
  }
  void add(const ChangeSet& other) {
    changed.insert(other.changed.slots());
    renewed.insert(other.renewed.slots());
    all = all || other.all;
    filters = filters || other.filters;
  }
};

}  // namespace broadcl
