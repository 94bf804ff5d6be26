#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/pair.hpp>

namespace broadcl {

/// A set of pairs in which those of a slot are found without a look at the others: each pair is in the lists
/// of its two slots.
class PairIndex {
 public:
  [[nodiscard]] std::size_t size() const noexcept { return links_.size() - free_.size(); }

  /// In canonical order.
  /// @throws std::bad_alloc
  [[nodiscard]] std::vector<Pair> all() const {
    std::vector<Pair> pairs;
    for (const Link& link : links_) {
      if (link.pair != no_pair) pairs.push_back(link.pair);
    }
    return sorted(std::move(pairs));
  }

  /// The pairs of some slots, in canonical order.
  /// @throws std::bad_alloc
  [[nodiscard]] std::vector<Pair> of(std::span<const std::uint32_t> slots) const {
    std::vector<Pair> pairs;
    for (const std::uint32_t slot : slots) {
      if (slot >= first_.size()) continue;
      for (std::uint32_t at = first_[slot]; at != none; at = links_[at / 2].next.at(at % 2))
        pairs.push_back(links_[at / 2].pair);
    }
    pairs = sorted(std::move(pairs));
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
    return pairs;
  }

  /// Reserves memory for so many more pairs, of slots below this one.
  /// @throws std::bad_alloc
  void reserve(std::size_t more, std::size_t slots) {
    if (links_.capacity() - links_.size() < more) links_.reserve(std::max(size() + more, links_.size() * 2));
    free_.reserve(links_.capacity());
    if (more > 0 && first_.size() < slots) first_.resize(slots, none);
  }

  /// Gives back memory that is not needed for these pairs.
  /// @throws std::bad_alloc; nothing has changed then.
  void shrink() {
    const std::vector<Pair> pairs = all();
    PairIndex other;
    other.reserve(pairs.size(), pairs.empty() ? 0 : pairs.back().b + 1);
    for (const Pair& pair : pairs) other.insert(pair);
    *this = std::move(other);
  }

  void clear() noexcept {
    for (const Link& link : links_) {
      if (link.pair != no_pair) first_[link.pair.a] = first_[link.pair.b] = none;
    }
    links_.clear();
    free_.clear();
  }

  /// @param pair Not in the set.
  void insert(const Pair& pair) noexcept {
    auto index = static_cast<std::uint32_t>(links_.size());
    if (free_.empty()) {
      links_.emplace_back();
    } else {
      index = free_.back();
      free_.pop_back();
    }
    links_[index] = {pair, {first_[pair.a], first_[pair.b]}, {none, none}};
    for (const std::uint32_t at : {2 * index, 2 * index + 1}) {
      if (const std::uint32_t next = next_of(at); next != none) previous_of(next) = at;
      first_[slot_of(at)] = at;
    }
  }

  /// @param pair In the set. It is found in the shorter one of its lists.
  void erase(const Pair& pair) noexcept {
    std::uint32_t of_a = first_[pair.a];
    std::uint32_t of_b = first_[pair.b];
    for (; links_[of_a / 2].pair != pair && links_[of_b / 2].pair != pair; of_b = next_of(of_b))
      of_a = next_of(of_a);
    const std::uint32_t index = (links_[of_a / 2].pair == pair ? of_a : of_b) / 2;
    for (const std::uint32_t at : {2 * index, 2 * index + 1}) {
      const std::uint32_t next = next_of(at);
      const std::uint32_t previous = previous_of(at);
      (previous == none ? first_[slot_of(at)] : next_of(previous)) = next;
      if (next != none) previous_of(next) = previous;
    }
    links_[index].pair = no_pair;
    free_.push_back(index);
  }

 private:
  static constexpr std::uint32_t none = ~std::uint32_t{0};
  static constexpr Pair no_pair{none, none};

  struct Link {
    Pair pair;
    std::array<std::uint32_t, 2> next, previous;  // in the lists of pair.a and pair.b; as in first_
  };

  // Of an entry of a list, which is twice the index of a link, plus 1 if the list is that of pair.b.
  [[nodiscard]] std::uint32_t slot_of(std::uint32_t at) const noexcept {
    return at % 2 == 0 ? links_[at / 2].pair.a : links_[at / 2].pair.b;
  }
  [[nodiscard]] std::uint32_t& next_of(std::uint32_t at) noexcept { return links_[at / 2].next.at(at % 2); }
  [[nodiscard]] std::uint32_t& previous_of(std::uint32_t at) noexcept {
    return links_[at / 2].previous.at(at % 2);
  }

  [[nodiscard]] static std::vector<Pair> sorted(std::vector<Pair> pairs) {
    if (!std::ranges::is_sorted(pairs)) std::ranges::sort(pairs);
    return pairs;
  }

  std::vector<std::uint32_t> first_;  // entries, by slot
  std::vector<Link> links_;
  std::vector<std::uint32_t> free_;  // links
};

}  // namespace broadcl
