#include "base/thread_pool.hpp"

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

/// What a caller shares; it lives on the caller's stack. All but the first three members are guarded by the
/// pool's mutex.
struct Work {
  void (*function)(void* context, std::size_t thread);
  void* context;
  std::size_t helpers;  // that are wanted
  std::size_t joined = 0;
  std::size_t active = 0;  // of those that joined
  Work* next = nullptr;    // that wants helpers, too
  std::condition_variable ended{};
};

/// After that, threads end. They start again when they are needed.
constexpr std::chrono::seconds longest_idle(10);

class Pool {
 public:
  void share(Work& work) {
    {
      const std::scoped_lock lock(mutex_);
      start_threads(work.helpers);
      work.next = first_;
      first_ = &work;
    }
    for (std::size_t k = 0; k < work.helpers; ++k) wanted_.notify_one();
    work.function(work.context, 0);
    std::unique_lock lock(mutex_);
    remove(work);
    work.ended.wait(lock, [&] { return work.active == 0; });
  }

 private:
  void start_threads(std::size_t count) {
    try {
      for (; threads_ < count; ++threads_) std::thread([this] { help(); }).detach();
    } catch (const std::exception&) {  // the system has no more threads, or no memory for them
    }
  }

  void help() {
    std::unique_lock lock(mutex_);
    while (wanted_.wait_for(lock, longest_idle, [&] { return first_ != nullptr; })) {
      Work& work = *first_;
      const std::size_t thread = ++work.joined;
      if (thread == work.helpers) first_ = work.next;
      ++work.active;
      lock.unlock();
      work.function(work.context, thread);
      lock.lock();
      // With the lock, without which the caller does not destroy its work.
      if (--work.active == 0) work.ended.notify_one();
    }
    --threads_;
  }

  void remove(const Work& work) {
    for (Work** link = &first_; *link != nullptr; link = &(*link)->next) {
      if (*link != &work) continue;
      *link = work.next;
      return;
    }
  }

  std::mutex mutex_;
  std::condition_variable wanted_;
  std::size_t threads_ = 0;
  Work* first_ = nullptr;  // the latest that wants helpers
};

/// Never destroyed, because its threads may outlive static destructors. A forked child has none of them, so
/// it makes another pool.
std::atomic<Pool*> the_pool = nullptr;

[[maybe_unused]] const bool is_made_anew = call_in_forks([] { the_pool = nullptr; });

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

void share_work(std::size_t helpers, void (*work)(void* context, std::size_t thread),
                void* context) noexcept {
  Pool* const helping = pool();
  if (helping == nullptr) return work(context, 0);
  Work shared{.function = work, .context = context, .helpers = helpers};
  helping->share(shared);
}

}  // namespace broadcl
