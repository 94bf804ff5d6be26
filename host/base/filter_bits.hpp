#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include <broadcl/filter.hpp>

namespace broadcl {

/// Which bits some of many filters have, and which all of them have. Filters come and go in any order, each
/// in a time that does not depend on how many there are.
class FilterBits {
 public:
  void add(const Filter& filter) noexcept {
    ++size_;
    change(filter, {});
  }
  /// @param filter Was added, and not removed since then.
  void remove(const Filter& filter) noexcept {
    --size_;
    change(filter, ones);
  }

  [[nodiscard]] bool empty() const noexcept { return size_ == 0; }
  /// The bits that some filter has.
  [[nodiscard]] Filter any() const noexcept {
    Words bits{};
    for (const Words& digit : digits_) {
      for (std::size_t k = 0; k < bits.size(); ++k) bits[k] |= digit[k];
    }
    return std::bit_cast<Filter>(bits);
  }
  /// The bits that all filters have.
  [[nodiscard]] Filter all() const noexcept {
    Words bits = ones;
    for (std::size_t place = 0; place < digits_.size(); ++place) {
      const std::uint32_t expected = (size_ >> place & 1U) != 0 ? 0xffffffff : 0;
      for (std::size_t k = 0; k < bits.size(); ++k) bits[k] &= ~(digits_[place][k] ^ expected);
    }
    return std::bit_cast<Filter>(bits);
  }

 private:
  using Words = std::array<std::uint32_t, sizeof(Filter) / sizeof(std::uint32_t)>;
  static constexpr Words ones{0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff};

  /// Adds 1 to the counts of the bits of a filter if `borrows` is zeros; subtracts 1 if it is ones.
  void change(const Filter& filter, const Words& borrows) noexcept {
    auto carry = std::bit_cast<Words>(filter);
    for (Words& digit : digits_) {
      std::uint32_t rest = 0;
      for (std::size_t k = 0; k < carry.size(); ++k) {
        const std::uint32_t next = (digit[k] ^ borrows[k]) & carry[k];
        digit[k] ^= carry[k];
        carry[k] = next;
        rest |= next;
      }
      if (rest == 0) return;
    }
  }

  std::uint32_t size_ = 0;
  // How many filters have each bit: one binary digit of all these counts per element, the lowest first.
  std::array<Words, 32> digits_{};
};

}  // namespace broadcl
