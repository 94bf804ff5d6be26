#pragma once

namespace broadcl::test {

/// Has OpenCL calls of this program fail with CL_OUT_OF_RESOURCES as long as it lives. One at a time.
class FailingOpenCl {
 public:
  /// @param first Calls that succeed before.
  /// @param count Calls that fail then; after these, calls succeed again.
  FailingOpenCl(long first, long count);
  ~FailingOpenCl();
  FailingOpenCl(const FailingOpenCl&) = delete;
  FailingOpenCl& operator=(const FailingOpenCl&) = delete;
  FailingOpenCl(FailingOpenCl&&) = delete;
  FailingOpenCl& operator=(FailingOpenCl&&) = delete;

  /// Calls that were made since it began, among those that can fail: all that allocate, enqueue or wait, and
  /// that set arguments.
  [[nodiscard]] static long calls() noexcept;
};

}  // namespace broadcl::test
