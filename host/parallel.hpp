#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <future>
#include <system_error>
#include <vector>

namespace broadcl {

/// Calls function(k, thread) once for each k < n, where `thread` is the number of the thread that does so,
/// below `threads`. The caller's thread takes part; fewer threads do if the system gives no more.
/// @throws What the function throws; the other calls are over then, or were left out.
template <class Function>
void parallel_for(std::size_t n, std::size_t threads, const Function& function) {
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
  others.reserve(std::min(threads, n));
  try {
    for (std::size_t thread = 1; thread < std::min(threads, n); ++thread) {
      others.push_back(std::async(std::launch::async, work, thread));
    }
  } catch (const std::system_error&) {  // there are no more threads
  }
  work(0);
  for (std::future<void>& other : others) other.get();
}

}  // namespace broadcl
