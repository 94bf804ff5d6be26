#pragma once

#include <atomic>
#include <stdexcept>

namespace broadcl::python {

/// Lets one thread at a time use an object, or any number that only query it; without the GIL others might
/// come.
class OneThread {
 public:
  /// Holds the object for as long as this lives.
  class Use {
   public:
    /// @throws RuntimeError if another thread holds or queries it.
    explicit Use(OneThread& object) : object_(object) {
      int users = 0;
      if (!object_.users_.compare_exchange_strong(users, alone, std::memory_order_acquire)) refuse();
    }
    ~Use() { object_.users_.store(0, std::memory_order_release); }
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;

   private:
    OneThread& object_;
  };

  /// Queries the object for as long as this lives.
  class Query {
   public:
    /// @throws RuntimeError if another thread holds it.
    explicit Query(OneThread& object) : object_(object) {
      int users = object_.users_.load(std::memory_order_relaxed);
      do {
        if (users == alone) refuse();
      } while (!object_.users_.compare_exchange_weak(users, users + 1, std::memory_order_acquire));
    }
    ~Query() { object_.users_.fetch_sub(1, std::memory_order_release); }
    Query(const Query&) = delete;
    Query& operator=(const Query&) = delete;

   private:
    OneThread& object_;
  };

 private:
  static constexpr int alone = -1;

  [[noreturn]] static void refuse() {
    throw std::runtime_error("another thread is using this object; give each thread its own, or use a lock");
  }

  std::atomic<int> users_ = 0;  // how many query it, or `alone`
};

}  // namespace broadcl::python
