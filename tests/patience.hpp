#pragma once

#include <chrono>
#include <thread>

namespace broadcl::test {

/// How long tests wait for another thread or a driver: longer than these need even if the machine is slow and
/// busy, and kernels have to be compiled.
inline constexpr std::chrono::minutes patience(10);

/// Whether a condition comes true. (Implementations may report late, from a thread of their own, that nothing
/// refers to a buffer any more.)
template <class Condition>
bool eventually(const Condition& condition) {
  const auto start = std::chrono::steady_clock::now();
  while (!condition()) {
    if (std::chrono::steady_clock::now() - start > patience) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return true;
}

}  // namespace broadcl::test
