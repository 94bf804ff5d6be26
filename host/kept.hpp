#pragma once

#include <atomic>
#include <memory>

namespace broadcl {

/// Whether anybody else holds what this points to. If nobody does, whoever did has finished with it, on
/// whatever thread.
template <class T>
[[nodiscard]] bool is_kept(const std::shared_ptr<T>& pointer) noexcept {
  if (pointer.use_count() > 1) return true;
  std::atomic_thread_fence(std::memory_order_acquire);  // use_count() does not order anything
  return false;
}

}  // namespace broadcl
