#include "base/thread_pool.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <new>
#include <thread>
#include <utility>

#include "base/control_groups.hpp"
#include "base/system.hpp"

namespace broadcl {
namespace {

/// An update shares work several times in a row. To put a thread to sleep and to wake it takes about as long
/// as this.
constexpr std::chrono::microseconds longest_spin(50);

/// Waits until a condition holds, or gives up soon.
template <class Condition>
void spin_until(const Condition& condition) {
  if (condition()) return;
  const auto end = std::chrono::steady_clock::now() + longest_spin;
  while (!condition() && std::chrono::steady_clock::now() < end) std::this_thread::yield();
}

/// After that, threads end. They start again when they are needed.
constexpr std::chrono::seconds longest_idle(10);

}  // namespace

/// Either has threads of its own, or helps in tasks that the application runs. A task belongs to no loop and
/// helps with the latest, if there is one. So it may be run at any time, or never.
class ThreadPool : public std::enable_shared_from_this<ThreadPool> {
 public:
  explicit ThreadPool(Executor executor = {}) : executor_(std::move(executor)) {}

  void share(ParallelLoop& loop) {
    {
      const std::unique_lock lock = acquire();
      if (!executor_) start_threads(loop.helpers_);
      loop.next_ = first_;
      first_ = &loop;
    }
    if (executor_) return submit_tasks(loop.helpers_);
    for (std::size_t k = 0; k < loop.helpers_; ++k) wanted_.notify_one();
  }

  /// No more helpers join; waits for those that did.
  void end(ParallelLoop& loop) {
    {
      const std::unique_lock lock = acquire();
      remove(loop);
    }
    spin_until([&] { return loop.active_ == 0; });
    std::unique_lock lock = acquire();
    loop.ended_.wait(lock, [&] { return loop.active_ == 0; });
  }

 private:
  /// The lock is mostly held for a few instructions only, so that spinning takes less time than sleeping.
  [[nodiscard]] std::unique_lock<std::mutex> acquire() {
    std::unique_lock lock(mutex_, std::defer_lock);
    spin_until([&] { return lock.try_lock(); });
    if (!lock) lock.lock();
    return lock;
  }

  void start_threads(std::size_t count) {
    try {
      for (; threads_ < count; ++threads_) std::thread([this] { help(); }).detach();
    } catch (const std::exception&) {  // the system has no more threads, or no memory for them
    }
  }

  void submit_tasks(std::size_t count) {
    try {
      for (; count > 0; --count) {
        executor_([pool = shared_from_this()] {
          if (pool->first_ == nullptr) return;  // before the lock, which a forked child might never get
          std::unique_lock lock = pool->acquire();
          if (pool->first_ != nullptr) pool->help_latest(lock);
        });
      }
    } catch (...) {  // as if the rest were never run
    }
  }

  /// @param lock Ends unlocked.
  void help_latest(std::unique_lock<std::mutex>& lock) {
    ParallelLoop& loop = *first_;
    const std::size_t thread = ++loop.joined_;
    if (thread == loop.helpers_) first_ = loop.next_;
    ++loop.active_;
    lock.unlock();
    while (loop.step(thread)) {
    }
    lock = acquire();
    // With the lock, without which the caller does not destroy its loop.
    if (--loop.active_ == 0) loop.ended_.notify_one();
    lock.unlock();
  }

  /// What a thread of the pool's own does.
  void help() {
    std::unique_lock lock = acquire();
    while (wanted_.wait_for(lock, longest_idle, [&] { return first_ != nullptr; })) {
      help_latest(lock);
      spin_until([&] { return first_ != nullptr; });
      lock = acquire();
    }
    --threads_;
  }

  void remove(const ParallelLoop& loop) {
    if (first_ == &loop) {
      first_ = loop.next_;
      return;
    }
    for (ParallelLoop* other = first_; other != nullptr; other = other->next_) {
      if (other->next_ == &loop) other->next_ = loop.next_;
    }
  }

  Executor executor_;  // empty if it has threads of its own
  std::mutex mutex_;
  std::condition_variable wanted_;
  std::size_t threads_ = 0;
  std::atomic<ParallelLoop*> first_ = nullptr;  // the latest that wants helpers
};

namespace {

/// Never destroyed, because its threads may outlive static destructors. A forked child has none of them, so
/// it makes another pool.
std::atomic<ThreadPool*> the_pool = nullptr;
std::atomic<std::size_t> processors = 0;       // 0 if unknown
std::atomic<std::size_t> processors_left = 0;  // to background work

[[maybe_unused]] const bool is_made_anew = call_in_forks([] {
  the_pool = nullptr;
  processors = processors_left = 0;
});

/// Null if there is no memory for it.
ThreadPool* pool() {
  ThreadPool* known = the_pool;
  if (known != nullptr) return known;
  auto* const made = new (std::nothrow) ThreadPool;
  if (the_pool.compare_exchange_strong(known, made)) return made;
  delete made;  // another thread was faster
  return known;
}

}  // namespace

BackgroundWork::BackgroundWork() noexcept {
  ++processors_left;
}
BackgroundWork::~BackgroundWork() {
  --processors_left;
}

std::size_t usable_processors() noexcept {
  const std::size_t known = processors;
  if (known != 0) return known;
  const std::size_t all = std::max(1U, std::thread::hardware_concurrency());
  try {
    return processors = std::min(all, control_group_processors());
  } catch (const std::exception&) {  // no memory, or a file that cannot be read: the next call tries again
    return all;
  }
}

std::size_t free_processors() noexcept {
  constexpr std::size_t few = 4;  // of these, one less would be felt more than sharing it
  const std::size_t all = usable_processors();
  return all < few ? all : std::max<std::size_t>(1, all - std::min<std::size_t>(all, processors_left));
}

Threads::Threads(const Config& config)
    : most(config.threads), pool(config.executor ? std::make_shared<ThreadPool>(config.executor) : nullptr) {}

ParallelLoop::ParallelLoop(std::size_t n, const Threads& threads, Function function)
    : n_(n),
      function_(std::move(function)),
      helpers_(std::max<std::size_t>(1, std::min(threads.most, n)) - 1) {
  if (helpers_ == 0) return;
  pool_ = threads.pool != nullptr ? threads.pool.get() : pool();
  if (pool_ != nullptr) pool_->share(*this);
}

bool ParallelLoop::step(std::size_t thread) noexcept {
  const std::size_t k = call_++;
  if (k >= n_) return false;
  try {
    function_(k, thread);
  } catch (...) {
    call_ = n_;
    if (!has_failed_.test_and_set()) error_ = std::current_exception();
  }
  return true;
}

void ParallelLoop::stop() noexcept {
  call_ = n_;
  if (ThreadPool* const pool = std::exchange(pool_, nullptr)) pool->end(*this);
}

void ParallelLoop::finish() {
  while (step()) {
  }
  stop();
  if (error_) std::rethrow_exception(error_);
}

}  // namespace broadcl
