#include "base/thread_pool.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <new>
#include <thread>

#include "base/system.hpp"

namespace broadcl {
namespace {

/// What a caller shares; it lives on the caller's stack. All but the first three members are changed only
/// with the pool's lock.
struct Work {
  void (*function)(void* context, std::size_t thread);
  void* context;
  std::size_t helpers;  // that are wanted
  std::size_t joined = 0;
  std::atomic<std::size_t> active = 0;  // of those that joined
  Work* next = nullptr;                 // that wants helpers, too
  std::condition_variable ended{};
};

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

class Pool {
 public:
  void share(Work& work) {
    {
      const std::unique_lock lock = acquire();
      start_threads(work.helpers);
      work.next = first_;
      first_ = &work;
    }
    for (std::size_t k = 0; k < work.helpers; ++k) wanted_.notify_one();
    work.function(work.context, 0);
    {
      const std::unique_lock lock = acquire();
      remove(work);
    }
    spin_until([&] { return work.active == 0; });
    std::unique_lock lock = acquire();
    work.ended.wait(lock, [&] { return work.active == 0; });
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

  void help() {
    std::unique_lock lock = acquire();
    while (wanted_.wait_for(lock, longest_idle, [&] { return first_ != nullptr; })) {
      Work& work = *first_;
      const std::size_t thread = ++work.joined;
      if (thread == work.helpers) first_ = work.next;
      ++work.active;
      lock.unlock();
      work.function(work.context, thread);
      lock = acquire();
      // With the lock, without which the caller does not destroy its work.
      if (--work.active == 0) work.ended.notify_one();
      lock.unlock();
      spin_until([&] { return first_ != nullptr; });
      lock = acquire();
    }
    --threads_;
  }

  void remove(const Work& work) {
    if (first_ == &work) {
      first_ = work.next;
      return;
    }
    for (Work* other = first_; other != nullptr; other = other->next) {
      if (other->next == &work) other->next = work.next;
    }
  }

  std::mutex mutex_;
  std::condition_variable wanted_;
  std::size_t threads_ = 0;
  std::atomic<Work*> first_ = nullptr;  // the latest that wants helpers
};

/// Never destroyed, because its threads may outlive static destructors. A forked child has none of them, so
/// it makes another pool.
std::atomic<Pool*> the_pool = nullptr;
std::atomic<std::size_t> processors = 0;       // 0 if unknown
std::atomic<std::size_t> processors_left = 0;  // to background work

[[maybe_unused]] const bool is_made_anew = call_in_forks([] {
  the_pool = nullptr;
  processors = processors_left = 0;
});

/// Null if there is no memory for it.
Pool* pool() {
  Pool* known = the_pool;
  if (known != nullptr) return known;
  auto* const made = new (std::nothrow) Pool;
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

std::size_t free_processors() noexcept {
  constexpr std::size_t few = 4;  // of these, one less would be felt more than sharing it
  if (processors == 0) processors = std::max(1U, std::thread::hardware_concurrency());
  const std::size_t all = processors;
  return all < few ? all : std::max<std::size_t>(1, all - std::min<std::size_t>(all, processors_left));
}

void share_work(std::size_t helpers, void (*work)(void* context, std::size_t thread),
                void* context) noexcept {
  Pool* const helping = pool();
  if (helping == nullptr) return work(context, 0);
  Work shared{.function = work, .context = context, .helpers = helpers};
  helping->share(shared);
}

}  // namespace broadcl
