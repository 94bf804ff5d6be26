#pragma once

namespace broadcl::test {

/// While it exists, allocations of the thread that made it fail, by operator new in all its forms. One at a
/// time per thread. OpenCL's own allocations neither count nor fail; other threads are not affected.
///
/// A program that links this file runs with a replaced operator new.
class FailingAllocations {
 public:
  /// @param first Allocations that succeed before.
  /// @param count Allocations that fail then; after these, allocations succeed again.
  FailingAllocations(long first, long count) noexcept;
  ~FailingAllocations();
  FailingAllocations(const FailingAllocations&) = delete;
  FailingAllocations& operator=(const FailingAllocations&) = delete;
  FailingAllocations(FailingAllocations&&) = delete;
  FailingAllocations& operator=(FailingAllocations&&) = delete;

  /// Allocations of this thread since it began.
  [[nodiscard]] static long allocations() noexcept;

  /// While one exists, allocations of this thread neither count nor fail: for the needs of the test itself.
  class Pause {
   public:
    Pause() noexcept;
    ~Pause();
    Pause(const Pause&) = delete;
    Pause& operator=(const Pause&) = delete;
    Pause(Pause&&) = delete;
    Pause& operator=(Pause&&) = delete;
  };
};

}  // namespace broadcl::test
