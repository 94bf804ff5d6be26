#pragma once

#include <algorithm>
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
      throw Error("an exclusion is of " + std::to_string(pair.a) + " and itself; give pairs of two ids");
    }
    if (pair.a > pair.b) std::swap(pair.a, pair.b);
  }
  std::ranges::sort(sorted);
  sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
  if (sorted.size() >= 0x7fffffff) throw Error("more than 2147483646 exclusions; give fewer");
  return sorted;
}

}  // namespace broadcl
