#include "scenes/thread_time.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

namespace broadcl::scenes {
namespace {

/// Computes until the calling thread has used that much CPU time.
void work(double seconds) {
  const double begin = thread_seconds();
  while (thread_seconds() - begin < seconds) {
  }
}

TEST(ThreadTime, CountsWhatThisThreadComputesAndNotWhatOthersDo) {
  constexpr double much = 0.2;
  std::atomic<double> of_other = 0;
  const double begin = thread_seconds();
  std::thread other([&] {
    const double own = thread_seconds();
    work(much);
    of_other = thread_seconds() - own;
  });
  other.join();
  EXPECT_GE(of_other, much);
  EXPECT_LT(thread_seconds() - begin, much / 2);  // which waited
  work(0.001);
  EXPECT_GE(thread_seconds() - begin, 0.001);
}

}  // namespace
}  // namespace broadcl::scenes
