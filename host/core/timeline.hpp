#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/conversion.hpp"
#include "core/change_set.hpp"
#include "core/state.hpp"

namespace broadcl {

/// Which slots changed since some moment, so that who goes back to a saved one compares no others. Nothing is
/// recorded until the first moment is asked for.
class Timeline {
 public:
  /// @param slots All are below.
  /// @throws std::bad_alloc
  void reserve(std::size_t slots) {
    for (BlockBits& changed : spans_) changed.resize(std::max(changed.size(), blocks_of(slots)));
  }

  /// The present moment.
  /// @throws std::bad_alloc
  [[nodiscard]] Moment now(std::size_t slots) {
    static std::atomic<std::uint64_t> last_of = 0;
    reserve(slots);
    if (spans_.empty()) of_ = ++last_of;
    if (spans_.empty() || any_) {
      spans_.emplace_back(blocks_of(slots));
      any_ = false;
    }
    if (spans_.size() > most_spans) {
      insert(spans_[0], spans_[1]);
      spans_.erase(spans_.begin());
      ++first_;
    }
    return {.of = of_, .number = first_ + spans_.size() - 1};
  }

  void record(const ChangeSet& changes) noexcept {
    if (spans_.empty() || changes.empty()) return;
    any_ = true;
    BlockBits& changed = spans_.back();
    if (changes.all || changes.changed().size() > changed.size() * boxes_per_block / 4) {
      known_ = first_ + spans_.size();
    } else {
      for (const std::uint32_t slot : changes.changed()) insert_bit(changed, slot);
    }
  }

  /// Those that changed after a moment, and perhaps others; none if all may have.
  /// @throws std::bad_alloc
  [[nodiscard]] std::optional<BlockBits> since(const Moment& moment) const {
    if (spans_.empty() || moment.of != of_ || moment.number < known_) return std::nullopt;
    BlockBits changed = spans_.back();
    for (std::size_t k = std::max(moment.number, first_) - first_; k + 1 < spans_.size(); ++k)
      insert(spans_[k], changed);
    return changed;
  }

 private:
  static constexpr std::size_t most_spans = 16;

  static void insert(const BlockBits& some, BlockBits& into) noexcept {
    for (std::size_t k = 0; k < into.size(); ++k) into[k] = static_cast<std::uint16_t>(into[k] | some[k]);
  }

  std::uint64_t of_ = 0;          // of moments
  std::uint64_t first_ = 0;       // the number of the moment at which the first span begins
  std::uint64_t known_ = 0;       // since earlier moments, all may have changed
  std::vector<BlockBits> spans_;  // from one moment to the next; none if nothing is recorded
  bool any_ = false;              // something changed in the last one
};

}  // namespace broadcl
