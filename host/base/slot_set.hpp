#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace broadcl {

/// A set of slots that takes as long to create as there are slots in it. Most others are told apart by a
/// single bit.
class SlotSet {
 public:
  /// @param slots Ascending. Must outlive the set.
  /// @throws std::bad_alloc
  explicit SlotSet(std::span<const std::uint32_t> slots) : slots_(slots) {
    if (slots.empty()) return;
    const std::size_t words = slots.back() / word_bits + 1;  // if each slot has a bit of its own
    bits_.resize(std::bit_ceil(std::min(words, slots.size())));
    is_exact_ = bits_.size() >= words;
    for (const std::uint32_t slot : slots) bits_[word_of(slot)] |= bit_of(slot);
  }

  [[nodiscard]] bool contains(std::uint32_t slot) const noexcept {
    return !slots_.empty() && (bits_[word_of(slot)] & bit_of(slot)) != 0 && slot <= slots_.back() &&
           (is_exact_ || std::ranges::binary_search(slots_, slot));
  }

 private:
  static constexpr std::uint32_t word_bits = 64;

  [[nodiscard]] std::size_t word_of(std::uint32_t slot) const noexcept {
    return slot / word_bits & (bits_.size() - 1);
  }
  [[nodiscard]] static std::uint64_t bit_of(std::uint32_t slot) noexcept {
    return std::uint64_t{1} << slot % word_bits;
  }

  std::span<const std::uint32_t> slots_;
  std::vector<std::uint64_t> bits_;  // of slots modulo their number
  bool is_exact_ = false;            // no two slots up to the last one share a bit
};

}  // namespace broadcl
