#pragma once

#include <stdexcept>

#include <broadcl/export.h>

namespace broadcl {

/// The one exception type of the library. Its text names what failed (for an OpenCL failure the device and
/// the call) and says what to do.
///
/// These rules hold for the whole library, unless the documentation of a function says otherwise.
/// - Errors: what throws, throws Error; std::bad_alloc passes through. A call that throws either has changed
///   nothing, and may be repeated.
/// - Threads: any number of threads may call functions that belong to no object, such as devices(),
///   select_device() and overlapping_pairs(), at the same time. One object may be used by one thread at a
///   time; different objects are independent of each other. Some functions read environment variables, so no
///   thread may set one meanwhile.
/// - Moves: an object that was moved from may be destroyed and assigned to, and nothing else.
class BROADCL_API Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace broadcl
