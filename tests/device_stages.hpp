#pragma once

#include <broadcl/device.hpp>

namespace broadcl::test {

/// Whether commands take time. (Mesa's rusticl 22.3 reports the same time for all of them.)
inline bool device_clock_ticks() {
  const Device device = select_device();
  return device.platform_name != "rusticl" || !device.driver_version.starts_with("22.");
}

}  // namespace broadcl::test
