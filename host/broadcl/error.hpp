#pragma once

#include <stdexcept>
#include <string>

#include <broadcl/export.h>

namespace broadcl {

/// What an Error is about, for programs that react to it. In C these are statuses, in Python classes of
/// exceptions. (Exhausted memory of the host is a std::bad_alloc.)
enum class ErrorKind {
  other,                 ///< Anything else that the text describes.
  invalid_argument,      ///< An argument cannot be used: an unknown id, or a NaN bound, for instance.
  out_of_device_memory,  ///< OpenCL has too little memory. The object can be used with fewer boxes or pairs.
  /// The device may be lost: create a new object. (Some drivers report exhausted memory in the same way.)
  device_lost
};

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
  explicit Error(const std::string& text, ErrorKind kind = ErrorKind::other)
      : std::runtime_error(text), kind_(kind) {}

  [[nodiscard]] static Error invalid_argument(const std::string& text) {
    return Error(text, ErrorKind::invalid_argument);
  }

  [[nodiscard]] ErrorKind kind() const noexcept { return kind_; }

 private:
  ErrorKind kind_;
};

}  // namespace broadcl
