#pragma once

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace broadcl::mpi {

/// Threads that wait for work: several times per update, for which starting threads takes too long.
/// One thread at a time may use an object, but for the work itself.
class Workers {
 public:
  /// @param threads That work at a time, the caller's included. They are started when they are needed, fewer
  /// if the system gives no more.
  explicit Workers(std::size_t threads) : threads_(threads) {}
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;
  Workers(Workers&&) = delete;
  Workers& operator=(Workers&&) = delete;

  [[nodiscard]] std::size_t threads() const noexcept { return threads_; }

  /// Calls function(k) once for each k < n; if that is more than one, on all threads.
  /// @throws What the function throws, and nothing else; the other calls are over then, or were left out.
  template <class Function>
  void for_each(std::size_t n, const Function& function) {
    if (n <= 1 || threads_ <= 1) {
      for (std::size_t k = 0; k < n; ++k) function(k);
      return;
    }
    run(n, std::cref(function));
  }

  /// Calls function(begin, end) for parts of 0 .. n-1 that together are all of it.
  template <class Function>
  void for_each_part(std::size_t n, std::size_t part, const Function& function) {
    for_each((n + part - 1) / part, [&](std::size_t k) { function(k * part, std::min(n, (k + 1) * part)); });
  }

 private:
  using Task = std::function<void(std::size_t)>;

  void run(std::size_t n, Task task);
  void start() noexcept;
  void wait_for_work() noexcept;
  void work(std::unique_lock<std::mutex>& lock) noexcept;
  [[nodiscard]] bool is_work_left() const noexcept { return next_ < count_; }

  std::size_t threads_;
  std::vector<std::thread> others_;

  std::mutex mutex_;  // of all that follows
  std::condition_variable begun_, done_;
  bool is_over_ = false;
  Task task_;
  std::size_t count_ = 0;
  std::size_t next_ = 0;
  std::size_t under_way_ = 0;
  std::exception_ptr failure_;
};

}  // namespace broadcl::mpi
