#pragma once

#include <LinearMath/btThreads.h>

#include <cstdint>

namespace broadcl::scenes {

/// Makes Bullet use its default task scheduler while this object exists. Bullet requires that the thread that
/// does this is the first one that used Bullet's threads. Only one such object may exist at a time.
class ScopedTaskScheduler {
 public:
  /// @param threads Includes the calling thread.
  /// @throws Error if Bullet or BroadCL was built without BT_THREADSAFE, or if the machine runs fewer
  /// threads.
  explicit ScopedTaskScheduler(std::uint32_t threads);
  ~ScopedTaskScheduler();
  ScopedTaskScheduler(const ScopedTaskScheduler&) = delete;
  ScopedTaskScheduler& operator=(const ScopedTaskScheduler&) = delete;
  ScopedTaskScheduler(ScopedTaskScheduler&&) = delete;
  ScopedTaskScheduler& operator=(ScopedTaskScheduler&&) = delete;

 private:
  btITaskScheduler* previous_;
};

}  // namespace broadcl::scenes
