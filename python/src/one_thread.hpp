#pragma once

#include <atomic>
#include <stdexcept>

namespace broadcl::python {

/// Lets one thread at a time use an object; without the GIL another one might come.
class OneThread {
 public:
  /// Holds the object for as long as this lives.
  class Use {
   public:
    /// @throws RuntimeError if another thread holds it.
    explicit Use(OneThread& object) : object_(object) {
      if (object_.is_used_.test_and_set(std::memory_order_acquire)) {
        throw std::runtime_error(
            "another thread is using this object; give each thread its own, or use a lock");
      }
    }
    ~Use() { object_.is_used_.clear(std::memory_order_release); }
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;

   private:
    OneThread& object_;
  };

 private:
  std::atomic_flag is_used_;
};

}  // namespace broadcl::python
