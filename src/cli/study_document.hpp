#pragma once

#include <broadcl/device.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/study_plan.hpp"

/// The file study.json: what a study measures, where, and all that is needed to repeat it.
namespace broadcl::cli {

/// Of a study that begins here and now. It has no devices yet.
[[nodiscard]] nlohmann::ordered_json new_document(const StudySettings& settings);

/// @throws nlohmann::json::exception where something is missing.
[[nodiscard]] StudySettings settings_of(const nlohmann::ordered_json& document);

/// The labels of its devices.
/// @throws nlohmann::json::exception where something is missing.
[[nodiscard]] std::vector<std::string> device_labels(const nlohmann::ordered_json& document);

/// Adds a device that is not among its devices yet.
/// @throws Error where it is, with another driver, and where another one's files have the same names.
void add_device(nlohmann::ordered_json& document, const Device& device);

/// Sets the command that does all of it again in a folder.
void set_command(nlohmann::ordered_json& document, const std::filesystem::path& folder);

/// What keeps times of this host and this build from being put beside those of the document; empty where
/// nothing does.
[[nodiscard]] std::string difference_from_here(const nlohmann::ordered_json& document);

}  // namespace broadcl::cli
