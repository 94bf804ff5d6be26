#pragma once

#include <cstddef>
#include <utility>

#include "engines/search.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {

/// All that there is of a frame on a device, as long as the next one needs it.
struct Frame {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
  /// The pairs: those that stay from the last frame at the beginning of a list, those that were added at its
  /// end.
  struct PairList {  // NOLINT(bugprone-exception-escape): as above
    opencl::GrowingBuffer buffer;
    std::size_t capacity = 0;
    std::size_t kept = 0;
    std::size_t added = 0;
    [[nodiscard]] std::size_t found() const noexcept { return kept + added; }
  };

  /// Where the counts are read, followed by the changes if they are needed on the host.
  struct Result {                // NOLINT(bugprone-exception-escape): as above
    opencl::SharedBuffer small;  ///< In direct memory, if there is any.
    opencl::SharedBuffer large;
    bool is_small = false;  ///< Whether the frame uses the first of these.
    [[nodiscard]] opencl::SharedBuffer& get() noexcept { return is_small ? small : large; }
    [[nodiscard]] const opencl::SharedBuffer& get() const noexcept { return is_small ? small : large; }
  };

  Generation objects;
  bool all_uploaded = true;       ///< All boxes were, not only objects in the slots in `changed`.
  opencl::GrowingBuffer changed;  ///< Slots.
  cl_uint changed_count = 0;
  // Memory for objects. `objects` may refer to that of the other frame if they did not change.
  opencl::GrowingBuffer boxes, filters, exclusions, ungrown;

  PairList pairs;
  cl::Buffer counts;  ///< kernels/counts.h
  Result result;
};

/// The frame that is begun, and the last one, which is intact until the other has succeeded.
struct Frames {  // NOLINT(bugprone-exception-escape): as above
  Frame now, last;
  void swap() noexcept { std::swap(now, last); }  // NOLINT(bugprone-exception-escape): as above
};

}  // namespace broadcl
