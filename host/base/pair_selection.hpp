#pragma once

#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/pair.hpp>

#include "base/parallel.hpp"

namespace broadcl {

/// Some pairs of a list, in its order, chosen by several threads if the list is long.
/// @param threads At most; 0 for one per processor.
/// @param select Called with a part of the list and a list to append its pairs to.
/// @throws std::bad_alloc
template <class Select>
[[nodiscard]] std::vector<Pair> select_pairs(std::span<const Pair> pairs, std::size_t threads,
                                             const Select& select) {
  constexpr std::size_t pairs_per_thread = 1 << 14;  // at least
  const std::size_t parts = useful_threads(pairs.size(), pairs_per_thread, threads);
  const auto begin_of = [&](std::size_t part) { return pairs.size() * part / parts; };
  std::vector<std::vector<Pair>> selected(parts);
  parallel_for(parts, parts, [&](std::size_t part, std::size_t /*thread*/) {
    std::vector<Pair> own;
    select(pairs.subspan(begin_of(part), begin_of(part + 1) - begin_of(part)), own);
    selected[part] = std::move(own);
  });
  std::vector<Pair> all = std::move(selected.front());
  for (std::size_t part = 1; part < parts; ++part) {
    all.insert(all.end(), selected[part].begin(), selected[part].end());
  }
  return all;
}

}  // namespace broadcl
