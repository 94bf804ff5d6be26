#pragma once

#include <string_view>

namespace broadcl::test {

/// Makes OpenCL calls of this program fail with CL_OUT_OF_RESOURCES while it exists. One at a time.
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

  /// Calls since it began, of those that can fail: all but those that retain and release.
  [[nodiscard]] static long calls() noexcept;

  /// The name of the function that failed last; empty if none ever did.
  [[nodiscard]] static std::string_view last_failed() noexcept;
};

/// What this program's OpenCL calls have done since it started, in all threads.
struct OpenClUse {
  long blocking_calls = 0;     ///< Calls that waited for the device.
  long memory_references = 0;  ///< To memory objects: one per creation and retain, less one per release.
  long mapped_regions = 0;     ///< Mappings, less those that have ended.
  long programs_built = 0;
  long most_built_at_once = 0;      ///< Programs, by several threads.
  long commands_without_event = 0;  ///< Kernels and copies.
  long transfers = 0;               ///< Copies between host and device.
};
[[nodiscard]] OpenClUse opencl_use() noexcept;

/// How often kernels were launched whose names begin like this.
[[nodiscard]] long launches_of(std::string_view kernel);

/// Waits until the device has completed all commands of the queue that was used last, which must still exist.
void wait_for_last_queue();

/// Whether the calling thread is inside an OpenCL call.
[[nodiscard]] bool is_inside_opencl() noexcept;

}  // namespace broadcl::test
