#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <span>
#include <string>
#include <vector>

#include <broadcl/error.hpp>
#include <broadcl/pair.hpp>

#include "base/system.hpp"

namespace broadcl {

/// The largest number of pairs that may overlap: indices of kernels are 32-bit numbers.
inline constexpr std::size_t most_pairs = std::size_t{1} << 31;

/// @throws Error if so many pairs overlap.
inline void refuse_too_many(std::size_t pairs) {
  if (pairs > most_pairs)
    throw Error("more than " + std::to_string(most_pairs) + " pairs overlap; use fewer boxes");
}

/// Makes a list large enough. Most of the time that a long new list takes is spent in page faults, so it gets
/// large pages.
/// @throws std::bad_alloc; the list is empty then, or as before.
inline void reserve_for_writing(std::vector<Pair>& pairs, std::size_t n) {
  if (n <= pairs.capacity()) return;
  pairs.clear();
  pairs.reserve(std::max(n, pairs.capacity() + pairs.capacity() / 2));
  use_large_pages(pairs.data(), pairs.capacity() * sizeof(Pair));
}

/// Resizes a list that is to be overwritten.
/// @throws As reserve_for_writing() does.
inline void resize_for_writing(std::vector<Pair>& pairs, std::size_t n) {
  reserve_for_writing(pairs, n);
  pairs.resize(n);
}

/// @throws std::bad_alloc
[[nodiscard]] inline std::vector<Pair> copy_of(std::span<const Pair> pairs) {
  std::vector<Pair> copy;
  reserve_for_writing(copy, pairs.size());
  copy.assign(pairs.begin(), pairs.end());
  return copy;
}

// Lists of pairs as sets: each in canonical order, without duplicates.

[[nodiscard]] inline std::vector<Pair> difference(std::span<const Pair> from, std::span<const Pair> without) {
  std::vector<Pair> result;
  std::set_difference(from.begin(), from.end(), without.begin(), without.end(), std::back_inserter(result));
  return result;
}

[[nodiscard]] inline std::vector<Pair> merge(std::span<const Pair> s, std::span<const Pair> t) {
  std::vector<Pair> result;
  std::set_union(s.begin(), s.end(), t.begin(), t.end(), std::back_inserter(result));
  return result;
}

[[nodiscard]] inline std::vector<Pair> intersection(std::span<const Pair> s, std::span<const Pair> t) {
  std::vector<Pair> result;
  std::set_intersection(s.begin(), s.end(), t.begin(), t.end(), std::back_inserter(result));
  return result;
}

/// Finds which pairs were added and removed between two such lists. Pairs of a recycled slot count as removed
/// and, if they are in both lists, as added again.
/// @param recycled Ascending.
inline void compare(std::span<const Pair> before, std::span<const Pair> now,
                    std::span<const std::uint32_t> recycled, std::vector<Pair>& added,
                    std::vector<Pair>& removed) {
  const auto is_recycled = [&](std::uint32_t slot) { return std::ranges::binary_search(recycled, slot); };
  added.clear();
  removed.clear();
  auto last = before.begin();
  for (const Pair& pair : now) {
    for (; last != before.end() && *last < pair; ++last) removed.push_back(*last);
    const bool was_pair = last != before.end() && *last == pair;
    const bool is_new = !was_pair || is_recycled(pair.a) || is_recycled(pair.b);
    if (is_new) added.push_back(pair);
    if (is_new && was_pair) removed.push_back(pair);
    if (was_pair) ++last;
  }
  removed.insert(removed.end(), last, before.end());
}

}  // namespace broadcl
