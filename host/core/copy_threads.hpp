#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <thread>

#include "base/parallel.hpp"

namespace broadcl {

/// How many threads copy boxes. With fewer boxes per thread, waking one takes longer than it saves; more
/// threads than this do not copy faster.
/// @param threads At most; 0 for one per processor.
[[nodiscard]] inline std::size_t copy_threads(std::size_t boxes, std::size_t threads) noexcept {
  constexpr std::size_t least_boxes = 4096;
  constexpr std::size_t most_threads = 8;
  const std::size_t useful = std::clamp<std::size_t>(boxes / least_boxes, 1, most_threads);
  return std::min(useful,
                  threads != 0 ? threads : std::max<std::size_t>(1, std::thread::hardware_concurrency()));
}

/// Makes an atomic number the lower one of itself and another.
inline void lower(std::atomic<std::size_t>& number, std::size_t other) noexcept {
  for (std::size_t known = number; other < known && !number.compare_exchange_weak(known, other);) {
  }
}

}  // namespace broadcl
