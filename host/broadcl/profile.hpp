#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <string_view>

namespace broadcl {

/// One stage of an update, for instance "upload" or "test". A name may occur several times in an update, and
/// there may be time between stages.
///
/// The clocks of host and device cannot be compared; their times are on separate timelines.
struct Stage {
  std::string_view name;  ///< A string literal of the library: always valid.
  double host_start;      ///< Seconds from the beginning of the update, by the host's steady clock.
  double host_seconds;    ///< Wall-clock time of the calling thread in this stage, including waits.
  double device_start;    ///< Seconds from the start of the update's first command, by the device's clock.
  /// Of all its commands together, by the same clock. Both are 0 for host stages and without Config::profile.
  double device_seconds;
};

}  // namespace broadcl

#endif
