#include "opencl/tuning.hpp"

#include <broadcl/error.hpp>

#include "base/system.hpp"

namespace broadcl::opencl {

const LaunchParameters& launch_parameters(Tuning tuning) noexcept {
  static constexpr LaunchParameters gpu{};
  static constexpr LaunchParameters gpu64{.tiles_group = 64};
  static constexpr LaunchParameters cpu{.group = 1,
                                        .blocks = 4,
                                        .min_scan_block = 16384,
                                        .max_merged = 0,
                                        .max_order_small = 256,
                                        .brute_force = {.width = 16,
                                                        .group = 1,
                                                        .min_rows = 256,
                                                        .max_rows = 4096,
                                                        .items = 256,
                                                        .most_tests = std::size_t{1} << 30},
                                        .gpu_bf = {.width = 16,
                                                   .group = 64,
                                                   .min_rows = 64,
                                                   .max_rows = 512,
                                                   .items = 1024,
                                                   .most_tests = std::size_t{1} << 30},
                                        .tiles_group = 1,
                                        .tiles_max_roots = 1,
                                        .tiles_max_workers = 1,
                                        .auto_tests = 120'000,
                                        .auto_tests_per_slot = 120,
                                        .uploads_boxes = false};
  return tuning == Tuning::cpu ? cpu : tuning == Tuning::gpu64 ? gpu64 : gpu;
}

std::string_view to_string(Tuning tuning) noexcept {
  switch (tuning) {
    case Tuning::gpu:
      return "gpu";
    case Tuning::gpu64:
      return "gpu64";
    case Tuning::cpu:
      break;
  }
  return "cpu";
}

std::optional<Tuning> named_tuning() {
  const auto name = environment("BROADCL_TUNING");
  if (!name) return std::nullopt;
  for (const Tuning tuning : {Tuning::gpu, Tuning::gpu64, Tuning::cpu}) {
    if (*name == to_string(tuning)) return tuning;
  }
  throw Error("BROADCL_TUNING is '" + *name + "'; set it to gpu, gpu64 or cpu");
}

}  // namespace broadcl::opencl
