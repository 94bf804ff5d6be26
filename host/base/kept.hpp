#pragma once

#include <atomic>
#include <memory>

namespace broadcl {

/// Memory that users may keep longer than an update, or than its object, is in a shared_ptr, of which they
/// get copies. Whether there are any; if not, all former users, in any thread, have finished with it.
template <class T>
[[nodiscard]] bool is_kept(const std::shared_ptr<T>& pointer) noexcept {
  if (pointer.use_count() > 1) return true;
  std::atomic_thread_fence(std::memory_order_acquire);  // use_count() does not order anything
  return false;
}

}  // namespace broadcl
