#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <future>
#include <new>
#include <system_error>
#include <thread>
#include <vector>

namespace broadcl {

/// Calls function(k, thread) once for each k < n; `thread`, below `threads`, is the number of the calling
/// thread. The caller's thread takes part. Uses fewer threads if the system cannot start more.
/// @throws What the function throws; the other calls have then returned or were not made.
template <class Function>
void parallel_for(std::size_t n, std::size_t threads, const Function& function) {
  if (std::min(threads, n) < 2) {
    for (std::size_t k = 0; k < n; ++k) function(k, std::size_t{0});
    return;
  }
  std::atomic<std::size_t> next{0};
  const auto work = [&](std::size_t thread) {
    try {
      for (std::size_t k = next++; k < n; k = next++) function(k, thread);
    } catch (...) {
      next = n;
      throw;
    }
  };
  std::vector<std::future<void>> others;
  others.reserve(std::min(threads, n) - 1);
  try {
    for (std::size_t thread = 1; thread < std::min(threads, n); ++thread) {
      others.push_back(std::async(std::launch::async, work, thread));
    }
  } catch (const std::system_error&) {  // there are no more threads
  }
  work(0);
  for (std::future<void>& other : others) other.get();
}

/// Splits 0 .. n-1 into parts and calls function(begin, end) for each, on all processors if there is much to
/// do.
/// @param function Must not throw; may be called again for the same part.
template <class Function>
void for_each_part(std::size_t n, const Function& function) noexcept {
  constexpr std::size_t part = std::size_t{1} << 18U;
  if (n < 4 * part) {
    function(std::size_t{0}, n);
    return;
  }
  try {
    parallel_for(
        (n + part - 1) / part, std::thread::hardware_concurrency(),
        [&](std::size_t k, std::size_t /*thread*/) { function(k * part, std::min(n, (k + 1) * part)); });
  } catch (const std::bad_alloc&) {  // there is no memory for more threads
    function(std::size_t{0}, n);
  }
}

}  // namespace broadcl
