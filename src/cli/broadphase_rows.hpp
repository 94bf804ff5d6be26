#pragma once

#include <string>

#include "cli/arguments.hpp"
#include "scenes/broadphases.hpp"

namespace broadcl::cli {

/// The table of broad phases, with the names that --broadphase takes.
[[nodiscard]] inline std::string broadphase_rows() {
  std::string text = "Broad phases:\n";
  for (const scenes::BroadphaseInfo& info : scenes::broadphases()) text += named_row(info.name, info.summary);
  return text;
}

}  // namespace broadcl::cli
