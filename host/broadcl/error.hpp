#pragma once

#include <stdexcept>

#include <broadcl/export.h>

namespace broadcl {

/// The exception type of the library. The text names what failed (for an OpenCL failure, the device and the
/// call) and says what to do.
///
/// These rules apply to the whole library, unless the documentation of a function says otherwise.
/// - Errors: functions throw Error, or std::bad_alloc. A call that throws has changed nothing, and may be
///   repeated.
/// - Threads: any number of threads may call functions that belong to no object, such as devices(),
///   select_device() and overlapping_pairs(), at the same time. An object may be used by only one thread at a
///   time; different objects are independent of each other. Some functions read environment variables, so no
///   thread may set one at the same time.
/// - Moves: an object that was moved from may only be destroyed or assigned to.
class BROADCL_API Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace broadcl
