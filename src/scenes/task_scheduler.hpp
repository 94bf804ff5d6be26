#pragma once

#include <LinearMath/btThreads.h>

#include <cstdint>
#include <memory>

namespace broadcl::scenes {

/// Bullet's default task scheduler. It is the one that Bullet uses while this object exists. As Bullet
/// demands, the thread that makes it must be the first one that used Bullet's threads.
class TaskScheduler {
 public:
  /// @param threads Includes the calling thread.
  /// @throws Error if Bullet or BroadCL was built without BT_THREADSAFE, or if the machine runs fewer
  /// threads.
  explicit TaskScheduler(std::uint32_t threads);
  ~TaskScheduler();
  TaskScheduler(const TaskScheduler&) = delete;
  TaskScheduler& operator=(const TaskScheduler&) = delete;
  TaskScheduler(TaskScheduler&&) = delete;
  TaskScheduler& operator=(TaskScheduler&&) = delete;

 private:
  std::unique_ptr<btITaskScheduler> scheduler_;
  btITaskScheduler* previous_;
};

}  // namespace broadcl::scenes
