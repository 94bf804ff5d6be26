#pragma once

#include "cli/study_folder.hpp"
#include "cli/study_plan.hpp"

namespace broadcl::cli {

/// Records one run of each scenario, for those who want to see it: recordings/SCENARIO.npy in the study's
/// folder, as many objects as the middle one of its numbers, 3,500 at most, and 300 frames at most. Those
/// that are there already stay. Pairs are found on the host: every exact broad phase makes the same run.
/// @throws Error where one cannot be written.
void record_scenes(const StudyFolder& folder, const StudySettings& settings);

}  // namespace broadcl::cli
