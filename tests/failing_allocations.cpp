#include "failing_allocations.hpp"

#include <cstddef>
#include <cstdlib>
#include <limits>
#include <new>

#include "failing_opencl.hpp"

namespace broadcl::test {
namespace {

constexpr long never = std::numeric_limits<long>::max();

/// Allocations of one thread.
struct Allocations {
  long made = 0;
  long first_failing = never;
  long first_succeeding = never;
  int pauses = 0;
};
constinit thread_local Allocations allocations_made;

/// Null if the allocation must fail, or fails by itself.
void* allocate(std::size_t bytes, std::align_val_t alignment = {}) noexcept {
  Allocations& state = allocations_made;
  if (state.pauses == 0 && !is_inside_opencl()) {
    const long allocation = state.made++;
    if (allocation >= state.first_failing && allocation < state.first_succeeding) return nullptr;
  }
  const auto multiple = static_cast<std::size_t>(alignment);
  if (multiple <= alignof(std::max_align_t)) return std::malloc(bytes > 0 ? bytes : 1);
  return std::aligned_alloc(multiple, (bytes + multiple - 1) / multiple * multiple);
}

void* allocated(void* memory) {
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}

}  // namespace

FailingAllocations::FailingAllocations(long first, long count) noexcept {
  allocations_made.made = 0;
  allocations_made.first_failing = first;
  allocations_made.first_succeeding = first > never - count ? never : first + count;
}

FailingAllocations::~FailingAllocations() {
  allocations_made.first_failing = never;
}

long FailingAllocations::allocations() noexcept {
  return allocations_made.made;
}

FailingAllocations::Pause::Pause() noexcept {
  ++allocations_made.pauses;
}

FailingAllocations::Pause::~Pause() {
  --allocations_made.pauses;
}

}  // namespace broadcl::test

using broadcl::test::allocate;
using broadcl::test::allocated;

// NOLINTBEGIN(misc-new-delete-overloads): each has its counterpart here
void* operator new(std::size_t bytes) {
  return allocated(allocate(bytes));
}
void* operator new[](std::size_t bytes) {
  return allocated(allocate(bytes));
}
void* operator new(std::size_t bytes, std::align_val_t alignment) {
  return allocated(allocate(bytes, alignment));
}
void* operator new[](std::size_t bytes, std::align_val_t alignment) {
  return allocated(allocate(bytes, alignment));
}
void* operator new(std::size_t bytes, const std::nothrow_t& /*tag*/) noexcept {
  return allocate(bytes);
}
void* operator new[](std::size_t bytes, const std::nothrow_t& /*tag*/) noexcept {
  return allocate(bytes);
}
void* operator new(std::size_t bytes, std::align_val_t alignment, const std::nothrow_t& /*tag*/) noexcept {
  return allocate(bytes, alignment);
}
void* operator new[](std::size_t bytes, std::align_val_t alignment, const std::nothrow_t& /*tag*/) noexcept {
  return allocate(bytes, alignment);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete[](void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t /*bytes*/) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::size_t /*bytes*/) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::align_val_t /*alignment*/) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::align_val_t /*alignment*/) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t /*bytes*/, std::align_val_t /*alignment*/) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::size_t /*bytes*/, std::align_val_t /*alignment*/) noexcept {
  std::free(memory);
}
void operator delete(void* memory, const std::nothrow_t& /*tag*/) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, const std::nothrow_t& /*tag*/) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::align_val_t /*alignment*/, const std::nothrow_t& /*tag*/) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::align_val_t /*alignment*/, const std::nothrow_t& /*tag*/) noexcept {
  std::free(memory);
}
// NOLINTEND(misc-new-delete-overloads)
