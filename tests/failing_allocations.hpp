#pragma once

namespace broadcl::test {

/// Makes allocations of the thread that made it fail as long as it lives, by operator new in all its forms.
/// One at a time per thread. What OpenCL allocates neither counts nor fails; other threads are left alone.
///
/// A program that links this file runs under a replaced operator new.
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

  /// While one lives, allocations of this thread neither count nor fail: for what a test does for itself.
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
