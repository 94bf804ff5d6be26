#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "cli/statistics.hpp"

/// The file of one run of a study, as csv_report() writes it.
namespace broadcl::cli {

/// One value per frame each; times in milliseconds.
struct RunFrames {
  std::vector<double> update;
  std::vector<double> broad_phase;
  std::vector<double> total;
  std::vector<std::size_t> pairs;
};

/// Times in milliseconds. Frame 0, the warm-up, is left out of everything but `first_frame_total`.
struct RunSummary {
  Summary update;
  Summary broad_phase;
  Summary total;
  double total_sum;
  double pairs_mean;
  std::size_t pairs_last;
  double first_frame_total;
};

/// Reads a file; none if it is damaged: if a frame is missing or a row is malformed.
[[nodiscard]] std::optional<RunFrames> parse_run_file(std::string_view text, std::uint32_t frames);

/// @param frames At least two.
[[nodiscard]] RunSummary summarize_run(const RunFrames& frames);

}  // namespace broadcl::cli
