#pragma once

#include <string>
#include <vector>

#include "scenes/scenario.hpp"

namespace broadcl::test {

inline std::vector<std::string> scenario_names() {
  std::vector<std::string> names;
  for (const scenes::ScenarioInfo& row : scenes::Scenario::list()) names.emplace_back(row.name);
  return names;
}

}  // namespace broadcl::test
