#pragma once

#include <chrono>

#include "scenes/thread_time.hpp"
#include "scenes/world.hpp"

namespace broadcl::scenes {

/// Times the two parts of a frame; `total` is their sum.
template <class Update, class Search>
FrameTimes timed_frame(const Update& update, const Search& search) {
  using Clock = std::chrono::steady_clock;
  const double cpu_begin = thread_seconds();
  const Clock::time_point begin = Clock::now();
  update();
  const Clock::time_point updated = Clock::now();
  const double cpu_updated = thread_seconds();
  const Clock::time_point search_begin = Clock::now();
  search();
  const Clock::time_point end = Clock::now();
  const std::chrono::duration<double> of_update = updated - begin;
  const std::chrono::duration<double> of_search = end - search_begin;
  const double cpu_end = thread_seconds();
  return {.update = of_update.count(),
          .broad_phase = of_search.count(),
          .total = of_update.count() + of_search.count(),
          .cpu = {.update = cpu_updated - cpu_begin,
                  .broad_phase = cpu_end - cpu_updated,
                  .total = cpu_end - cpu_begin}};
}

}  // namespace broadcl::scenes
