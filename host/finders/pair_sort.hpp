#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <broadcl/pair.hpp>

#include "base/threads.hpp"

namespace broadcl {

/// Sorts pairs into canonical order on the host: moves them to partitions by the upper bits of b, each of
/// which fits into a cache, and sorts these with a radix sort.
class PairSort {
 public:
  /// @param lists Lists of pairs, for instance one per thread.
  /// @param slots Greater than every slot of the pairs.
  /// @param sorted Receives all pairs.
  /// @throws std::bad_alloc
  void operator()(std::span<const std::span<const Pair>> lists, std::size_t slots, const Threads& threads,
                  std::vector<Pair>& sorted);

 private:
  std::vector<std::vector<Pair>> scratch_;           // one per thread
  std::vector<std::vector<std::size_t>> positions_;  // of the next pair of a list in a partition
};

}  // namespace broadcl
