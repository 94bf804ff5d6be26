#pragma once

#include <stdexcept>

namespace broadcl {

/// The one exception type of the library. Its text names what failed (for an OpenCL failure the device and
/// the call) and says what to do. If a call throws, the object it was made on is as it was before, unless
/// its documentation says otherwise.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace broadcl
