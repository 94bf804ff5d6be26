#pragma once

#include <cstddef>
#include <optional>
#include <string_view>

namespace broadcl::opencl {

/// The tuning of kernels: many small work-items that share local memory (gpu), the same on a GPU that
/// runs 64 of them in lockstep (gpu64), or few work-items that each do a lot of work (cpu).
enum class Tuning { gpu, gpu64, cpu };

/// Of a kernel that tests all pairs: a work-item has the pairs of a few columns with a run of rows.
struct RowLaunch {
  unsigned width;          ///< Columns per work-item.
  unsigned group;          ///< Work-items per work-group.
  unsigned min_rows;       ///< Rows per work-item, at least.
  unsigned max_rows;       ///< And at most.
  unsigned items;          ///< Work-items wanted per compute unit, as far as min_rows and max_rows allow.
  std::size_t most_tests;  ///< Per launch, so that no watchdog ends it.
};

/// The launch parameters that depend on the tuning; the defaults are those of Tuning::gpu.
struct LaunchParameters {
  /// Work-items per work-group of the kernels of common.cl that have local memory.
  std::size_t group = 256;
  /// Of lists that are sorted or added up, wanted per compute unit.
  std::size_t blocks = 8;
  /// Values per block that is added up, at least: a multiple of four per work-item.
  std::size_t min_scan_block = 4096;
  /// Elements that are sorted by tiles that are merged, at most: these are launches less, but merging
  /// searches each tile for each element.
  std::size_t max_merged = 65536;
  /// Changes per list that are ordered in one launch, at most.
  std::size_t max_order_small = 8192;
  RowLaunch brute_force{.width = 4,
                        .group = 128,
                        .min_rows = 16,
                        .max_rows = 256,
                        .items = 2500,
                        .most_tests = std::size_t{1} << 32};
  RowLaunch gpu_bf{.width = 4,
                   .group = 128,
                   .min_rows = 8,
                   .max_rows = 128,
                   .items = 4096,
                   .most_tests = std::size_t{1} << 32};
  /// Work-items per work-group of `tiles`: one per child of a node, as many as a GPU runs in step; or one.
  std::size_t tiles_group = 32;
  /// Nodes at which a search of `tiles` starts, at most: a launch more would leave fewer.
  std::size_t tiles_max_roots = 8;
  /// Work-groups that share the search of a tile, at most.
  std::size_t tiles_max_workers = 8;
  /// Tests of `brute-force`, at most, in a frame of `auto`, for each compute unit: as many as a device does
  /// in the time that `tiles` take even if no boxes overlap. To check: scripts/bench FILE
  /// --benchmark_filter='^(update|some-moving|frame)/(auto|brute-force|tiles)/'
  double auto_tests = 100'000;
  /// And more for each slot, since `tiles` look at all boxes although few moved.
  double auto_tests_per_slot = 14;
  /// Whether to upload boxes while others are still copied. (A CPU would only copy them once more.)
  bool uploads_boxes = true;
};

[[nodiscard]] const LaunchParameters& launch_parameters(Tuning tuning) noexcept;

/// "gpu", "gpu64" or "cpu".
[[nodiscard]] std::string_view to_string(Tuning tuning) noexcept;

/// The tuning that the environment variable BROADCL_TUNING names, if any.
/// @throws Error if it names none.
[[nodiscard]] std::optional<Tuning> named_tuning();

}  // namespace broadcl::opencl
