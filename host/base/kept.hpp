#pragma once

#include <atomic>
#include <memory>

namespace broadcl {

/// Whether there are other owners of the object that this points to. If not, all former owners, in any
/// thread, have finished with it.
template <class T>
[[nodiscard]] bool is_kept(const std::shared_ptr<T>& pointer) noexcept {
  if (pointer.use_count() > 1) return true;
  std::atomic_thread_fence(std::memory_order_acquire);  // use_count() does not order anything
  return false;
}

}  // namespace broadcl
