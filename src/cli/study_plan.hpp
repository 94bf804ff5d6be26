#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// What `broadcl study` measures, and in which order.
namespace broadcl::cli {

/// A number of objects above which a study leaves a broad phase out.
struct StudyLimit {
  std::string broadphase;
  std::uint32_t objects;
  std::string why;  ///< The reason, for people; empty if the user asked for it.

  friend bool operator==(const StudyLimit&, const StudyLimit&) = default;
};

/// Every combination of scenario, number of objects and broad phase is simulated several times.
struct StudySettings {
  std::string preset;                    ///< The name of the preset that the rest is derived from.
  std::vector<std::string> scenarios;    ///< Names of scenes::Scenario::list().
  std::vector<std::uint32_t> objects;    ///< Numbers of objects.
  std::vector<std::string> broadphases;  ///< Names of scenes::broadphases().
  std::uint32_t frames;                  ///< Per run, including the warm-up.
  std::uint32_t repeat;                  ///< Runs per combination.
  std::uint64_t seed = 1;                ///< Of the simulations and of the order of the runs.
  std::vector<StudyLimit> limits;
  std::vector<std::string> left_out;  ///< What else the preset leaves out, and why; for people.
  bool auto_on_host = false;          ///< Whether `auto` is measured, and has no device that it would use.
};

/// A row of the table of presets.
struct StudyPreset {
  std::string summary;  ///< One line for people.
  StudySettings settings;
};

/// paper, quick and large.
[[nodiscard]] std::vector<StudyPreset> study_presets();

/// @throws Error for an unknown name, listing the known ones.
[[nodiscard]] StudySettings find_study_preset(std::string_view name);

/// The parts of the preset that are not measured, and why, one per line.
[[nodiscard]] std::vector<std::string> cut_of(const StudySettings& settings);

/// The limits as an option takes them: "NAME=N" each.
[[nodiscard]] std::vector<std::string> limit_texts(const std::vector<StudyLimit>& limits);

/// One simulation of a study.
struct StudyRun {
  std::string scenario;
  std::uint32_t objects;
  std::string broadphase;
  std::string device;    ///< Its label; empty for the host.
  std::uint32_t repeat;  ///< From 1.
};

[[nodiscard]] bool is_auto(const std::string& broadphase);

/// Whether a broad phase is measured on each device, otherwise on the host.
[[nodiscard]] bool runs_on_devices(const StudySettings& settings, const std::string& broadphase);

/// A label of a device as part of a file name: lower-case letters, digits and single hyphens. Never empty.
[[nodiscard]] std::string slug(std::string_view label);

/// "free-fall, 500 objects, tiles on PLATFORM / DEVICE, repetition 1"
[[nodiscard]] std::string describe(const StudyRun& run);

/// The name of a run's combination: SCENARIO-OBJECTS-BROADPHASE[-DEVICE].
[[nodiscard]] std::string combination_of(const StudyRun& run);

/// The name of a run's file: its combination and repetition, and `.csv`.
[[nodiscard]] std::string file_name(const StudyRun& run);

/// All runs, sorted by scenario, objects, broad phase, device and repetition, each in the order of the
/// settings.
/// @param devices Their labels.
[[nodiscard]] std::vector<StudyRun> planned_runs(const StudySettings& settings,
                                                 std::span<const std::string> devices);

/// The same runs in a random order that depends only on the seed, so that drifts of the machine's speed
/// affect all of them alike.
[[nodiscard]] std::vector<StudyRun> in_random_order(std::vector<StudyRun> runs, std::uint64_t seed);

}  // namespace broadcl::cli
