#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>

#include "base/thread_pool.hpp"

namespace broadcl {

/// What threads write is aligned to this, so that they do not wait for each other's caches.
inline constexpr std::size_t cache_line = 64;

/// How many threads n things are worth, at most.
/// @param least How many things pay for waking a thread.
[[nodiscard]] inline Threads useful_threads(std::size_t n, std::size_t least, const Threads& threads) {
  const std::size_t useful = n / least;
  if (useful < 2) return 1;
  return {std::min(useful, threads.most != 0 ? threads.most : free_processors()), threads.pool};
}

/// Calls function(k, thread) once for each k < n; `thread`, below `threads.most`, is the number of the
/// calling thread. The caller's thread takes part; uses fewer threads if others are busy.
/// @throws What the function throws; the other calls have then returned or were not made.
template <class Function>
void parallel_for(std::size_t n, const Threads& threads, const Function& function) {
  if (std::min(threads.most, n) < 2) {
    for (std::size_t k = 0; k < n; ++k) function(k, std::size_t{0});
  } else {
    ParallelLoop(n, threads, std::cref(function)).finish();
  }
}

}  // namespace broadcl
