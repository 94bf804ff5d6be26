#pragma once

#include <string>

#include "cli/study_folder.hpp"
#include "cli/study_plan.hpp"

namespace broadcl::cli {

/// Records one run of each scenario, for those who want to see it: recordings/SCENARIO.npy in the study's
/// folder, as many objects as the middle one of its numbers, 3,500 at most, and 300 frames at most. Those
/// that are there already stay.
/// @param device Where `auto` finds the pairs, as select_device() takes it; where empty, the host does.
/// @throws Error where one cannot be written, and as simulate() does.
void record_scenes(const StudyFolder& folder, const StudySettings& settings, const std::string& device);

}  // namespace broadcl::cli
