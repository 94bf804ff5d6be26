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

std::unique_ptr<btITaskScheduler> make_scheduler(std::uint32_t threads) {
  std::unique_ptr<btITaskScheduler> scheduler(btCreateDefaultTaskScheduler());
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
  return scheduler;
}

}  // namespace

TaskScheduler::TaskScheduler(std::uint32_t threads)
    : scheduler_(make_scheduler(threads)), previous_(btGetTaskScheduler()) {
  btSetTaskScheduler(scheduler_.get());
}

TaskScheduler::~TaskScheduler() {
  btSetTaskScheduler(previous_);
}

}  // namespace broadcl::scenes
