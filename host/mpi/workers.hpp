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

/// Threads that wait for work. Work comes several times per update, and starting threads each time would take
/// too long. Only one thread at a time may call functions of an object.
class Workers {
 public:
  /// @param threads Number of threads, including the caller's. They are started when they are first needed;
  /// fewer if the system cannot start more.
  explicit Workers(std::size_t threads) : threads_(threads) {}
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;
  Workers(Workers&&) = delete;
  Workers& operator=(Workers&&) = delete;

  [[nodiscard]] std::size_t threads() const noexcept { return threads_; }

  /// Calls function(k) once for each k < n; if that is more than one, on all threads.
  /// @throws What the function throws, and nothing else; the other calls have then returned or were not made.
  template <class Function>
  void for_each(std::size_t n, const Function& function) {
    if (n <= 1 || threads_ <= 1) {
      for (std::size_t k = 0; k < n; ++k) function(k);
      return;
    }
    run(n, std::cref(function));
  }

  /// Splits 0 .. n-1 into parts and calls function(begin, end) for each.
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
