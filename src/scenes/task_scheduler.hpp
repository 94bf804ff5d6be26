#pragma once

#include <LinearMath/btThreads.h>

#include <cstdint>

namespace broadcl::scenes {

/// Makes Bullet use its default task scheduler while this object exists. As Bullet demands, the thread that
/// does so must be the first one that used Bullet's threads. There must be one such object at a time.
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
