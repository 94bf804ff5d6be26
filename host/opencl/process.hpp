#pragma once

#include <broadcl/export.h>

namespace broadcl::opencl {

// A process that is forked has copies of its parent's OpenCL objects, but not the threads of the drivers:
// each call may hang or crash, even one that releases an object.

/// Must be called before anything of OpenCL is.
/// @throws Error in a process that was forked, directly or not, from one that had called this.
BROADCL_API void use_in_this_process();

/// Whether this is such a process. Whatever belongs to OpenCL must then be left alone; the system frees it.
[[nodiscard]] BROADCL_API bool is_forked() noexcept;

/// Deletes an object that contains OpenCL objects, unless the process was forked.
struct DeleteUnlessForked {
  template <class T>
  void operator()(T* object) const noexcept {
    if (!is_forked()) delete object;
  }
};

}  // namespace broadcl::opencl
