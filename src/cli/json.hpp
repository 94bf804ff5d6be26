#pragma once

#include <broadcl/device.hpp>
#include <nlohmann/json.hpp>
#include <string>

namespace broadcl::cli {

[[nodiscard]] inline nlohmann::ordered_json json_of(const Device& device) {
  return {{"id", device.id()},
          {"type", to_string(device.type)},
          {"platform", device.platform_name},
          {"name", device.name},
          {"version", device.version},
          {"driver_version", device.driver_version},
          {"compute_units", device.compute_units},
          {"clock_mhz", device.clock_mhz},
          {"memory", device.memory},
          {"max_allocation", device.max_allocation},
          {"host_unified", device.host_unified},
          {"vendor_id", device.vendor_id}};
}

/// The text of a document. Device names may contain bytes that are not UTF-8, as JSON must be; these are
/// replaced.
[[nodiscard]] inline std::string text_of(const nlohmann::ordered_json& document) {
  return document.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace broadcl::cli
