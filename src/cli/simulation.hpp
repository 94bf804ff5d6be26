#pragma once

#include <broadcl/device.hpp>
#include <broadcl/profile.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/recording.hpp"
#include "scenes/scenario.hpp"
#include "scenes/verify.hpp"
#include "scenes/world.hpp"

class btBroadphaseInterface;

/// What `broadcl simulate` is asked for and what it finds; `broadcl replay` finds the same.
namespace broadcl::cli {

struct SimulationConfig {
  scenes::Scenario::Config scenario{.name = "mixed-sizes"};
  std::uint32_t frames = 2048;
  std::string broadphase = "auto";  ///< A name of scenes::broadphases().
  std::string device;               ///< As select_device() takes it.
  bool verify = false;              ///< Compare every frame with the oracle.
  bool profile = false;             ///< Report the stages of the broad phase.
  bool trace = false;               ///< Keep the stages for a trace.
};

/// How the frames compare with the oracle. Broad phases that are not exact may have extra pairs.
struct Verdict {
  bool exact = false;       ///< Extra pairs are wrong.
  std::size_t missing = 0;  ///< Pairs, the sum over all frames.
  std::size_t extra = 0;
  std::optional<std::uint32_t> first_wrong_frame;
};

/// A value a frame each; times in milliseconds.
struct SimulationResult {
  std::vector<std::chrono::steady_clock::time_point> start;
  std::vector<double> update_start;  ///< From the start of the frame.
  std::vector<double> update;
  std::vector<double> broad_phase_start;  ///< From the start of the frame.
  std::vector<double> broad_phase;
  std::vector<double> total;
  std::vector<std::size_t> pairs;
  /// Of the broad phase: none where they were not asked for, and where it has none.
  std::vector<std::vector<Stage>> stages;
  std::optional<Device> device;  ///< None where the broad phase runs on the host.
  std::optional<Verdict> verdict;
};

/// Frames that are measured, one after the other.
struct Frames {
  std::uint32_t count;
  std::function<scenes::FrameTimes()> step;
  std::function<scenes::Difference()> verify;  ///< Of the last frame, off the clock; none if not asked for.
  std::function<void()> ended;                 ///< Called after each, off the clock.
};

/// Measures frames.
/// @param name That of the broad phase in scenes::broadphases().
/// @param broadphase Its errors are this function's from now on.
/// @param stages Keep the stages of the broad phase.
/// @throws Error when the device fails: what is found on the host from then on does not count.
[[nodiscard]] SimulationResult measure(const Frames& frames, const std::string& name,
                                       btBroadphaseInterface& broadphase, bool stages);

/// Runs one.
/// @param frame_ended Called after each frame, off the clock.
/// @param recording Gets the boxes of the objects as the broad phase has them, the walls left out, at the
/// start and after each frame, off the clock; none where it is null. It must be made of recording_info().
/// @throws Error for an unknown name or device, as measure() does, and as RecordingWriter::write().
[[nodiscard]] SimulationResult simulate(const SimulationConfig& config,
                                        const std::function<void()>& frame_ended,
                                        RecordingWriter* recording = nullptr);

/// What a recording of a simulation will be.
/// @throws Error for an unknown scenario.
[[nodiscard]] RecordingInfo recording_info(const SimulationConfig& config);

/// Of BroadCL and of Bullet.
[[nodiscard]] nlohmann::ordered_json versions();
/// What every document tells of its simulation: "config", "device" and "versions".
[[nodiscard]] nlohmann::ordered_json facts(const SimulationConfig& config, const SimulationResult& result);
/// A row a frame: frame,update_ms,broad_phase_ms,total_ms,pairs.
[[nodiscard]] std::string csv_report(const SimulationResult& result);
/// The configuration and the summary.
[[nodiscard]] std::string json_report(const SimulationConfig& config, const SimulationResult& result);
/// The summary for people.
[[nodiscard]] std::string table_report(const SimulationConfig& config, const SimulationResult& result);

/// json_report() for frames of another origin, which "config" tells.
[[nodiscard]] std::string json_report_of(const nlohmann::ordered_json& config,
                                         const SimulationResult& result);
/// table_report() for frames of another origin.
/// @param heading The lines that tell where the frames come from, and of which broad phase.
[[nodiscard]] std::string table_report_of(const std::string& heading, const SimulationResult& result);

}  // namespace broadcl::cli
