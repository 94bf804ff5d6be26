#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>

#include <broadcl/export.h>

#include "base/non_copyable.hpp"
#include "base/threads.hpp"

namespace broadcl {

/// Calls function(k, thread) once for each k < n, in order as calls begin: in the thread that has this
/// object, as number 0, and in threads of a pool that are free, or become free before stop() or finish()
/// returns. So nobody waits for others' work, and loops may be nested. (Exported for the MPI component.)
///
/// The library's own pool has as many threads as the largest number of helpers that was wanted so far, or as
/// the system could start. They start when they are needed, and end when they have been idle for ten seconds;
/// a forked child starts its own. Other pools consist of the threads that run an Executor's tasks.
class BROADCL_API ParallelLoop {
 public:
  using Function = std::function<void(std::size_t k, std::size_t thread)>;

  /// Other threads begin at once.
  ParallelLoop(std::size_t n, const Threads& threads, Function function);
  ~ParallelLoop() { stop(); }

  /// Makes the next call.
  /// @returns Whether there was one left.
  bool step(std::size_t thread = 0) noexcept;
  /// Leaves out the calls that were not made, and waits for those of other threads.
  void stop() noexcept;
  /// Makes the calls that are left, and waits for those of other threads.
  /// @throws What the function throws; the other calls have then returned or were not made.
  void finish();

 private:
  friend class ThreadPool;

  std::size_t n_;
  Function function_;
  std::atomic<std::size_t> call_ = 0;  // the next one
  std::atomic_flag has_failed_{};
  std::exception_ptr error_;    // of the first call that failed
  std::size_t helpers_;         // that are wanted
  ThreadPool* pool_ = nullptr;  // in which it is
  // Changed only with the pool's lock.
  std::size_t joined_ = 0;
  std::atomic<std::size_t> active_ = 0;  // of those that joined
  ParallelLoop* next_ = nullptr;         // that wants helpers, too
  std::condition_variable ended_{};
};

/// While it exists, free_processors() leaves a processor to a thread that is not of the pool, so that no
/// helper has to wait for it.
class BackgroundWork : NonCopyable {
 public:
  BackgroundWork() noexcept;
  ~BackgroundWork();
};

/// The number of processors on which this process may have threads: by its affinity, and on Linux by its
/// control groups, too.
[[nodiscard]] BROADCL_API std::size_t usable_processors() noexcept;
/// The same without those that are left to background work, if there are at least four.
[[nodiscard]] BROADCL_API std::size_t free_processors() noexcept;

}  // namespace broadcl
