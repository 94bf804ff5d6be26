#include "scenes/task_scheduler.hpp"

#include <broadcl/error.hpp>
#include <string>

#include "scenes/world.hpp"

namespace broadcl::scenes {
namespace {

static_assert(World::most_threads == BT_MAX_THREAD_COUNT);

// Bullet's locks are inline functions: compiled without BT_THREADSAFE they do nothing, and the linker may
// choose those for the whole program.
#if defined(BT_THREADSAFE) && BT_THREADSAFE
constexpr bool has_locks = true;
#else
constexpr bool has_locks = false;
#endif

/// Null if Bullet has no threads. Never destroyed: if a thread of Bullet 3.24's scheduler is not yet asleep,
/// the destructor writes before the start of an array (in waitForResponse(), if no thread has finished).
btITaskScheduler* default_scheduler() {
  static btITaskScheduler* const scheduler = btCreateDefaultTaskScheduler();
  return scheduler;
}

btITaskScheduler& scheduler_with(std::uint32_t threads) {
  btITaskScheduler* const scheduler = default_scheduler();
  if (scheduler == nullptr || !has_locks) {
    throw Error(std::to_string(threads) + " threads need BT_THREADSAFE, and " +
                (scheduler == nullptr ? "Bullet" : "BroadCL") +
                " was built without it; build Bullet with -D BULLET2_MULTITHREADING=ON and BroadCL with "
                "-D CMAKE_CXX_FLAGS=-DBT_THREADSAFE=1, or use 1 thread");
  }
  const int most = scheduler->getMaxNumThreads();
  if (static_cast<int>(threads) > most) {
    throw Error("Bullet uses at most " + std::to_string(most) + " threads on this machine, not " +
                std::to_string(threads) + "; use fewer");
  }
  scheduler->setNumThreads(static_cast<int>(threads));
  return *scheduler;
}

}  // namespace

ScopedTaskScheduler::ScopedTaskScheduler(std::uint32_t threads) : previous_(btGetTaskScheduler()) {
  btSetTaskScheduler(&scheduler_with(threads));
}

ScopedTaskScheduler::~ScopedTaskScheduler() {
  btSetTaskScheduler(previous_);
}

}  // namespace broadcl::scenes
