#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include <broadcl/error.hpp>

#include "base/system.hpp"
#include "engines/algorithm.hpp"
#include "engines/engine.hpp"

namespace broadcl {
namespace {

constexpr std::array rows{
    AlgorithmRow{
        {.name = "auto",
         .summary =
             "starts as sweep-and-prune on the host, and uses brute-force or tiles on a GPU once that is "
             "expected to be faster; if a CPU is named as the device, uses these two there",
         .on_device = true},
        make_auto,
        make_auto},
    AlgorithmRow{{.name = "brute-force",
                  .summary = "brute force, pairs and their changes found on the device",
                  .on_device = true},
                 nullptr,
                 make_brute_force},
    AlgorithmRow{{.name = "tiles",
                  .summary = "boxes sorted in space from time to time, and tested tile by tile",
                  .on_device = true},
                 nullptr,
                 make_tiles},
    AlgorithmRow{
        {.name = "gpu-bf",
         .summary =
             "brute force, one byte per pair, changes found by XOR on the host (Serpa and Rodrigues 2014)",
         .on_device = true},
        make_gpu_bf,
        nullptr},
    AlgorithmRow{
        {.name = "sweep-and-prune",
         .summary =
             "boxes sorted into tiles, which are swept along one axis, on threads of the host; needs no "
             "OpenCL",
         .on_device = false},
        [](const Config& config) { return make_sweep_and_prune(Threads(config)); },
        nullptr},
    AlgorithmRow{{.name = "oracle",
                  .summary = "brute force on one thread of the host, the reference for tests",
                  .on_device = false},
                 make_oracle,
                 nullptr},
};

constexpr auto infos = [] {
  std::array<AlgorithmInfo, rows.size()> result{};
  for (std::size_t k = 0; k < rows.size(); ++k) result[k] = rows[k].info;
  return result;
}();

}  // namespace

std::span<const AlgorithmInfo> algorithms() noexcept {
  return infos;
}

const AlgorithmRow& find_algorithm(std::string_view name) {
  const auto* row =
      std::find_if(rows.begin(), rows.end(), [&](const auto& r) { return r.info.name == name; });
  if (row != rows.end()) return *row;
  std::string names;
  for (const AlgorithmRow& r : rows) names += (names.empty() ? "" : ", ") + std::string(r.info.name);
  throw Error::invalid_argument("no algorithm is named '" + std::string(name) +
                                "'; the algorithms are: " + names);
}

bool names_device(const Config& config) {
  return !config.device.empty() || environment("BROADCL_DEVICE");
}

std::optional<Device> device_for(const Config& config) {
  if (!find_algorithm(config.algorithm).info.on_device) return std::nullopt;
  const bool is_auto = config.algorithm == "auto";
  if (is_auto && (!names_device(config) || opencl::is_forked())) return std::nullopt;
  Device device = select_device(config.device);
  if (is_auto && device.type != DeviceType::cpu) return std::nullopt;
  return device;
}

AlgorithmPointer make_algorithm(const Config& config) {
  const AlgorithmRow& row = find_algorithm(config.algorithm);
  return row.make != nullptr ? row.make(config) : make_device_algorithm(config, row.make_finder);
}

MakePairFinder find_pair_finder(std::string_view name) {
  const AlgorithmRow& row = find_algorithm(name);
  if (row.make_finder != nullptr) return row.make_finder;
  std::string names;
  for (const AlgorithmRow& r : rows) {
    if (r.make_finder != nullptr) names += (names.empty() ? "" : ", ") + std::string(r.info.name);
  }
  throw Error::invalid_argument("the algorithm '" + std::string(name) +
                                "' needs the host; use one of: " + names);
}

}  // namespace broadcl
