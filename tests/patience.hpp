#pragma once

#include <chrono>

namespace broadcl::test {

/// How long tests wait for another thread or a driver: longer than these need even if the machine is slow and
/// busy, and kernels have to be compiled.
inline constexpr std::chrono::minutes patience(10);

}  // namespace broadcl::test
