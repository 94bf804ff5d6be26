#pragma once

#include <string>
#include <vector>

#include <broadcl/device.hpp>

namespace broadcl::cli {

/// Whether two devices are the same card, offered by two drivers. A card is identified by its PCI address,
/// otherwise by its UUID, otherwise by name and memory. CPUs, and devices of the same platform, never count
/// as the same card.
[[nodiscard]] bool is_same_card(const Device& a, const Device& b);

/// Why an empty selector chooses the device that it does, for people: for instance, "it is the only GPU". A
/// card that several drivers offer counts once.
/// @throws Error as select_device() does.
[[nodiscard]] std::string reason_for_default(const std::vector<Device>& among);

}  // namespace broadcl::cli
