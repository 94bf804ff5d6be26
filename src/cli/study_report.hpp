#pragma once

#include <string>
#include <vector>

#include "cli/study_folder.hpp"
#include "cli/study_plan.hpp"

namespace broadcl::cli {

/// For people: the median total time of the frames by scenario and number of objects, one column per broad
/// phase, one table per device, and where the files are.
[[nodiscard]] std::string study_report(const StudyFolder& folder, const StudySettings& settings,
                                       const std::vector<StudyRun>& runs);

}  // namespace broadcl::cli
