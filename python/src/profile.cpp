#include "profile.hpp"

namespace nb = nanobind;

namespace broadcl::python {

nb::dict to_dict(std::span<const Stage> stages) {
  nb::dict result;
  for (const Stage& stage : stages) {
    const nb::str name(stage.name.data(), stage.name.size());
    if (!result.contains(name)) {
      nb::dict first;
      first["host_seconds"] = 0.0;
      first["device_seconds"] = 0.0;
      result[name] = first;
    }
    const nb::object times = result[name];
    times["host_seconds"] = nb::cast<double>(times["host_seconds"]) + stage.host_seconds;
    times["device_seconds"] = nb::cast<double>(times["device_seconds"]) + stage.device_seconds;
  }
  return result;
}

nb::dict to_dict(const MemoryUse& memory) {
  nb::dict result;
  result["device"] = memory.device;
  result["device_peak"] = memory.device_peak;
  result["pinned"] = memory.pinned;
  return result;
}

}  // namespace broadcl::python
