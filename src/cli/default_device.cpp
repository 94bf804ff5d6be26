#include "cli/default_device.hpp"

#include <algorithm>
#include <optional>

#include "base/system.hpp"

namespace broadcl::cli {
namespace {

bool is_discrete(const Device& device) {
  return device.type == DeviceType::gpu && !device.host_unified;
}

/// For each card, the device of the driver that is chosen by default.
std::vector<Device> one_per_card(const std::vector<Device>& devices) {
  std::vector<Device> cards;
  for (const Device& device : devices) {
    const auto known =
        std::ranges::find_if(cards, [&](const Device& other) { return is_same_card(device, other); });
    if (known == cards.end()) {
      cards.push_back(device);
    } else {
      *known = select_device({}, {*known, device});
    }
  }
  return cards;
}

/// Why the default is what it is.
/// @param among One device per card.
std::string why_best(const Device& best, const std::vector<Device>& among) {
  if (among.size() == 1) return "it is the only device";
  const auto discrete = std::ranges::count_if(among, is_discrete);
  const auto of_type = std::ranges::count(among, best.type, &Device::type);
  const bool is_gpu = best.type == DeviceType::gpu;
  const std::string kind = is_gpu ? "GPU" : best.type == DeviceType::cpu ? "CPU" : "device";
  const std::string no_gpu = is_gpu ? "" : "there is no GPU, and ";
  if (of_type == 1) return no_gpu + "it is the only " + kind;
  if (is_discrete(best) && discrete == 1) return "it is the only GPU with memory of its own";
  if (is_discrete(best) && discrete < of_type) {
    return "it has the most arithmetic units times clock frequency of the GPUs with memory of their own";
  }
  return no_gpu + "it has the most arithmetic units times clock frequency of the " + kind + "s";
}

}  // namespace

bool is_same_card(const Device& a, const Device& b) {
  if (a.platform == b.platform || a.type == DeviceType::cpu || b.type == DeviceType::cpu) return false;
  if (!a.pci_address.empty() && !b.pci_address.empty()) return a.pci_address == b.pci_address;
  if (!a.uuid.empty() && !b.uuid.empty()) return a.uuid == b.uuid;
  return a.name == b.name && a.memory == b.memory;
}

std::string reason_for_default(const std::vector<Device>& among) {
  if (const std::optional<std::string> variable = environment("BROADCL_DEVICE")) {
    return "BROADCL_DEVICE is '" + *variable + "'";
  }
  const Device best = select_device({}, among);
  std::string reason = why_best(best, one_per_card(among));
  for (const Device& device : among) {
    if (is_same_card(device, best)) reason += "; " + device.id() + " is the same card with another driver";
  }
  return reason;
}

}  // namespace broadcl::cli
