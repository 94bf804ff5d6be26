#pragma once

#include <algorithm>
#include <iterator>
#include <span>
#include <vector>

#include <broadcl/pair.hpp>

namespace broadcl {

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

}  // namespace broadcl
