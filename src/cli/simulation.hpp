#pragma once

#include <broadcl/device.hpp>
#include <broadcl/profile.hpp>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "cli/recording.hpp"
#include "scenes/scenario.hpp"
#include "scenes/verify.hpp"
#include "scenes/world.hpp"

class btBroadphaseInterface;

/// Configuration and result of `broadcl simulate`; `broadcl replay` has the same result.
namespace broadcl::cli {

struct SimulationConfig {
  scenes::Scenario::Config scenario{.name = "mixed-sizes"};
  std::uint32_t frames = 2048;
  std::uint32_t threads = 1;        ///< As scenes::World takes them.
  std::string broadphase = "auto";  ///< As scenes::find_broadphase() takes it.
  std::string device;               ///< As select_device() takes it.
  bool verify = false;              ///< Compare every frame with the oracle.
  bool profile = false;             ///< Report the stages of the broad phase.
};

/// How the frames compare with the oracle. A broad phase that is not exact may have extra pairs.
struct Verdict {
  bool exact = false;       ///< Whether extra pairs count as wrong.
  std::size_t missing = 0;  ///< Missing pairs, summed over all frames.
  std::size_t extra = 0;    ///< Extra pairs, summed over all frames.
  std::optional<std::uint32_t> first_wrong_frame;
};

/// Milliseconds of the parts of a frame; one value per frame each.
struct CpuMilliseconds {
  std::vector<double> update;
  std::vector<double> broad_phase;
  std::vector<double> total;
};

/// One value per frame each; times in milliseconds.
struct SimulationResult {
  std::vector<double> update;
  std::vector<double> broad_phase;
  std::vector<double> total;
  CpuMilliseconds cpu;  ///< Of the thread that simulates.
  std::vector<std::size_t> pairs;
  /// Of the broad phase; empty if they were not asked for or if it has none.
  std::vector<std::vector<Stage>> stages;
  std::optional<Device> device;  ///< Of the last frame; none if that was on the host.
  std::optional<Verdict> verdict;
};

/// Frames to measure, one after the other.
struct Frames {
  std::uint32_t count;
  std::function<scenes::FrameTimes()> step;
  std::function<scenes::Difference()> verify;  ///< Verifies the last frame, untimed; empty if not asked for.
  std::function<void()> ended;                 ///< Called after each frame, untimed.
};

/// What a broad phase says of itself after a frame.
struct BroadPhaseReports {
  std::function<std::size_t()> pairs;
  std::function<std::optional<Device>()> device;
  std::function<std::vector<Stage>()> stages{};  ///< Empty if they are not asked for.
  std::function<std::string()> error{};  ///< The last error that it did not throw; "" for none. May be empty.
};

/// Measures frames.
/// @param exact Whether extra pairs count as wrong.
/// @throws Error when the device fails: times of the fallback on the host would be meaningless.
[[nodiscard]] SimulationResult measure(const Frames& frames, bool exact, const BroadPhaseReports& reports);
/// @param name The name of the broad phase in scenes::broadphases().
/// @param broadphase Its error handler is replaced.
/// @param stages Whether to record the stages of the broad phase.
/// @throws Error when the device fails: times of the fallback on the host would be meaningless.
[[nodiscard]] SimulationResult measure(const Frames& frames, const std::string& name,
                                       btBroadphaseInterface& broadphase, bool stages);

/// Runs a simulation.
/// @param frame_ended Called after each frame, untimed.
/// @param recording Receives the boxes of the objects (not of the walls), as the broad phase has them, at the
/// start and after each frame, untimed; may be null. It must have been made with recording_info().
/// @throws Error for an unknown name or device, and as scenes::World, measure() and RecordingWriter::write()
/// do.
[[nodiscard]] SimulationResult simulate(const SimulationConfig& config,
                                        const std::function<void()>& frame_ended,
                                        RecordingWriter* recording = nullptr);

/// Describes the recording of a simulation.
/// @throws Error for an unknown scenario.
[[nodiscard]] RecordingInfo recording_info(const SimulationConfig& config);

/// The versions of BroadCL and of Bullet.
[[nodiscard]] nlohmann::ordered_json versions();
/// One row per frame: its number, times by the wall clock and of the thread's CPU, and the number of pairs.
[[nodiscard]] std::string csv_report(const SimulationResult& result);
/// The configuration and the summary.
[[nodiscard]] std::string json_report(const SimulationConfig& config, const SimulationResult& result);
/// The summary for people.
[[nodiscard]] std::string table_report(const SimulationConfig& config, const SimulationResult& result);

/// The lines of a report that say what was simulated, and what the times are of.
[[nodiscard]] std::string scenario_line(const SimulationConfig& config);
extern const std::string_view times_of_simulation;

/// The summaries of several broad phases, one row each, for people.
/// @param heading Lines that say where the frames come from.
/// @param explained Lines that say what the times are of.
/// @param broadphases Their names.
/// @param results One per name; the first one is what the others are compared with.
[[nodiscard]] std::string comparison_report(const std::string& heading, std::string_view explained,
                                            std::span<const std::string> broadphases,
                                            std::span<const SimulationResult> results);

/// The same times as a picture (SVG).
/// @param heading A line that says where the frames come from.
[[nodiscard]] std::string svg_report(const std::string& heading, std::span<const std::string> broadphases,
                                     std::span<const SimulationResult> results);

/// json_report() for frames from another source, which `config` describes.
[[nodiscard]] std::string json_report_of(const nlohmann::ordered_json& config,
                                         const SimulationResult& result);
/// table_report() for frames from another source.
/// @param heading Lines that say where the frames come from and which broad phase ran.
/// @param broadphase Its name.
[[nodiscard]] std::string table_report_of(const std::string& heading, const std::string& broadphase,
                                          const SimulationResult& result);

}  // namespace broadcl::cli
