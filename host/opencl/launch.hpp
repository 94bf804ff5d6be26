#pragma once

#include <cstddef>

#include "opencl/api.hpp"

namespace broadcl::opencl {

/// The smallest multiple that is not less than a value.
[[nodiscard]] constexpr std::size_t round_up(std::size_t value, std::size_t multiple) noexcept {
  return (value + multiple - 1) / multiple * multiple;
}

/// The number of pieces of the given size that some items fill; the last may be smaller.
[[nodiscard]] constexpr std::size_t divide_up(std::size_t items, std::size_t size) noexcept {
  return (items + size - 1) / size;
}

/// Sets the arguments of a kernel from the given one on; returns the index after the last of them.
/// @throws cl::Error
template <class... Arguments>
cl_uint set_arguments(cl::Kernel& kernel, cl_uint first, const Arguments&... arguments) {
  (kernel.setArg(first++, arguments), ...);
  return first;
}

/// A kernel that runs in work-groups of any size, and the size that it is launched with.
struct SizedKernel {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
  cl::Kernel kernel{};
  std::size_t group = 0;  ///< Work-items per work-group.

  /// Enqueues this many work-items, and as many more as fill the last work-group.
  /// @param event Is set to that of the command, unless it is null.
  /// @throws cl::Error
  void enqueue(const cl::CommandQueue& queue, std::size_t items, cl::Event* event = nullptr) const {
    queue.enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(round_up(items, group)), cl::NDRange(group),
                               nullptr, event);
  }
};

/// Waits until the queue has completed all commands, for destructors, and after a failure that is reported
/// anyway: an error is ignored. (Not by finish(), because Mesa's rusticl 22.3 returns early from one that
/// follows a flush.)
inline void wait_if_possible(const cl::CommandQueue& queue) noexcept {
  try {
    cl::Event end;
    queue.enqueueMarkerWithWaitList(nullptr, &end);
    end.wait();
  } catch (const cl::Error&) {
    return;
  }
}

}  // namespace broadcl::opencl
