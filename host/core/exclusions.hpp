#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/error.hpp>
#include <broadcl/pair.hpp>

namespace broadcl {

/// Pairs that are never to be reported, in canonical order and each once.
/// @throws Error for a pair of an object with itself, and for more than kernels can count.
[[nodiscard]] inline std::vector<Pair> sorted_exclusions(std::span<const Pair> pairs) {
  std::vector<Pair> sorted(pairs.begin(), pairs.end());
  for (Pair& pair : sorted) {
    if (pair.a == pair.b) {
      throw Error::invalid_argument("an exclusion is of " + std::to_string(pair.a) +
                                    " and itself; give pairs of two ids");
    }
    if (pair.a > pair.b) std::swap(pair.a, pair.b);
  }
  if (!std::ranges::is_sorted(sorted)) std::ranges::sort(sorted);
  sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
  if (sorted.size() >= 0x7fffffff)
    throw Error::invalid_argument("more than 2147483646 exclusions; give fewer");
  return sorted;
}

/// Checks pairs of an index below `first` with an index below `second` that are never to be reported.
/// @throws Error if there is no such index.
inline void refuse_unknown(std::span<const Pair> exclusions, std::size_t first, std::size_t second) {
  for (const Pair& pair : exclusions) {
    if (pair.a < first && pair.b < second) continue;
    throw Error::invalid_argument("the exclusion (" + std::to_string(pair.a) + ", " + std::to_string(pair.b) +
                                  ") is of a box that is not there; give indices below " +
                                  std::to_string(first) +
                                  (first == second ? "" : " and " + std::to_string(second)));
  }
}

}  // namespace broadcl
