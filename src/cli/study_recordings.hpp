#pragma once

#include "cli/study_folder.hpp"
#include "cli/study_plan.hpp"

namespace broadcl::cli {

/// Records one run of each scenario for the replay: recordings/SCENARIO.npy in the study's folder, with the
/// middle one of the study's numbers of objects, at most 3,500, and at most 300 frames. Existing recordings
/// stay. The pairs are found on the host, since every exact broad phase leads to the same run.
/// @throws Error if a recording cannot be written.
void record_scenes(const StudyFolder& folder, const StudySettings& settings);

}  // namespace broadcl::cli
