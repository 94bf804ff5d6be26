#pragma once

#include <sys/resource.h>
#include <unistd.h>

#include <cstddef>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

namespace broadcl::test {

/// Bytes of this process: addresses that it has, and what of them is in memory.
struct ProcessMemory {
  std::size_t addresses = 0;
  std::size_t resident = 0;

  static ProcessMemory now() {
    ProcessMemory pages;
    std::ifstream("/proc/self/statm") >> pages.addresses >> pages.resident;
    const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
    return {.addresses = pages.addresses * page, .resident = pages.resident * page};
  }

  /// The most bytes in memory since reset_peak().
  static std::size_t peak() {
    std::ifstream status("/proc/self/status");
    for (std::string word; status >> word;) {
      std::size_t kib = 0;
      if (word == "VmHWM:" && status >> kib) return kib << 10U;
    }
    return 0;
  }
  static void reset_peak() { std::ofstream("/proc/self/clear_refs") << 5; }
};

/// From now on this process, for instance a forked child, gets at most so many more bytes.
inline void limit_memory(std::size_t more) {
  const std::size_t most = ProcessMemory::now().addresses + more;
  const rlimit limit{.rlim_cur = most, .rlim_max = most};
  ASSERT_EQ(setrlimit(RLIMIT_AS, &limit), 0);
}

}  // namespace broadcl::test
