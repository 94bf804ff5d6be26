#pragma once

#include <broadcl/device.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/study_plan.hpp"

/// The file study.json: what a study measures, on which machine, and everything needed to repeat it.
namespace broadcl::cli {

/// The document of a study that begins here and now. It has no devices yet.
[[nodiscard]] nlohmann::ordered_json new_document(const StudySettings& settings);

/// @returns Whether the document, which somebody may have edited, has a size that a study can have, and only
/// scenarios that exist: their names become parts of paths.
/// @throws nlohmann::json::exception if something is missing.
[[nodiscard]] bool is_sound(const nlohmann::ordered_json& document);

/// The settings of the study.
/// @throws nlohmann::json::exception if something is missing.
[[nodiscard]] StudySettings settings_of(const nlohmann::ordered_json& document);

/// The labels of its devices.
/// @throws nlohmann::json::exception if something is missing.
[[nodiscard]] std::vector<std::string> device_labels(const nlohmann::ordered_json& document);

/// Adds a device unless it is there already.
/// @throws Error if it is there with another driver version, or if the files of another device have the same
/// names.
void add_device(nlohmann::ordered_json& document, const Device& device);

/// Sets the command that repeats the whole study in a folder.
void set_command(nlohmann::ordered_json& document, const std::filesystem::path& folder);

/// Why times of this host and this build cannot be compared with those of the document; empty if they can.
[[nodiscard]] std::string difference_from_here(const nlohmann::ordered_json& document);

}  // namespace broadcl::cli
