#pragma once

#include <string_view>

namespace broadcl {

/// One stage of an update, for instance "upload" or "test".
struct Stage {
  std::string_view name;  ///< A string literal of the library: always valid.
  double host_seconds;    ///< Wall clock that the calling thread spent in this stage, waiting included.
  double device_seconds;  ///< From the device's own clock; 0 for host stages and without Config::profile.
};

}  // namespace broadcl
