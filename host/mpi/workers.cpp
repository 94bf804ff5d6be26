#include "mpi/workers.hpp"

#include <utility>

namespace broadcl::mpi {

Workers::~Workers() {
  {
    const std::scoped_lock lock(mutex_);
    is_over_ = true;
  }
  begun_.notify_all();
  for (std::thread& other : others_) other.join();
}

void Workers::run(std::size_t n, Task task) {
  start();
  std::unique_lock lock(mutex_);
  task_ = std::move(task);
  count_ = n;
  next_ = 0;
  lock.unlock();
  if (n > others_.size()) {
    begun_.notify_all();
  } else {
    for (std::size_t k = 1; k < n; ++k) begun_.notify_one();
  }
  lock.lock();
  work(lock);
  done_.wait(lock, [this] { return under_way_ == 0; });
  task_ = nullptr;
  if (failure_ != nullptr) std::rethrow_exception(std::exchange(failure_, nullptr));
}

void Workers::start() noexcept try {
  others_.reserve(threads_ - 1);
  while (others_.size() < threads_ - 1) others_.emplace_back([this] { wait_for_work(); });
} catch (const std::exception&) {  // there is no memory, or there are no threads
}

void Workers::wait_for_work() noexcept {
  std::unique_lock lock(mutex_);
  while (!is_over_) {
    work(lock);
    begun_.wait(lock, [this] { return is_over_ || is_work_left(); });
  }
}

void Workers::work(std::unique_lock<std::mutex>& lock) noexcept {
  while (is_work_left()) {
    const std::size_t k = next_++;
    ++under_way_;
    lock.unlock();
    std::exception_ptr failure;
    try {
      task_(k);
    } catch (...) {
      failure = std::current_exception();
    }
    lock.lock();
    if (failure != nullptr) {
      failure_ = failure;
      next_ = count_;
    }
    if (--under_way_ == 0) done_.notify_one();
  }
}

}  // namespace broadcl::mpi
