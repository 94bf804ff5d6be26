#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>

#include "base/parallel.hpp"
#include "base/threads.hpp"

namespace broadcl {

/// Boxes are read and written in parts of so many, by several threads if there are many. (Nothing but tests
/// changes it, so that a few boxes are several parts, to another multiple of 16.)
inline constinit std::size_t boxes_per_part = 2048;  // NOLINT(*-avoid-non-const-global-variables): see above

[[nodiscard]] inline std::size_t parts_of(std::size_t boxes) noexcept {
  return (boxes + boxes_per_part - 1) / boxes_per_part;
}

/// How many threads n boxes are worth: with few per thread, waking it takes longer than it saves; with more
/// than eight threads, memory is not faster.
/// @param threads At most; 0 for one per processor.
[[nodiscard]] inline Threads threads_of(std::size_t n, const Threads& threads) {
  const std::size_t least_boxes = 2 * boxes_per_part;
  constexpr std::size_t most_threads = 8;
  return useful_threads(std::min(n, most_threads * least_boxes), least_boxes, threads);
}

/// Calls function(begin, end, thread) for each part of 0 .. n-1. The first box of a part is a multiple of
/// boxes_per_part.
/// @param threads As above.
/// @throws As parallel_for().
template <class Function>
void for_each_part(std::size_t n, const Threads& threads, const Function& function) {
  parallel_for(parts_of(n), threads_of(n, threads), [&](std::size_t k, std::size_t thread) {
    function(k * boxes_per_part, std::min(n, (k + 1) * boxes_per_part), thread);
  });
}

/// The lowest of some numbers below n that several threads find.
class LowestFound {
 public:
  explicit LowestFound(std::size_t n) noexcept : n_(n), lowest_(n) {}

  void add(std::size_t number) noexcept {
    for (std::size_t known = lowest_; number < known && !lowest_.compare_exchange_weak(known, number);) {
    }
  }
  [[nodiscard]] bool any() const noexcept { return lowest_ < n_; }
  /// n if there is none.
  [[nodiscard]] std::size_t get() const noexcept { return lowest_; }

 private:
  std::size_t n_;
  std::atomic<std::size_t> lowest_;
};

}  // namespace broadcl
