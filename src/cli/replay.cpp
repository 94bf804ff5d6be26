#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <broadcl/device.hpp>
#include <broadcl/error.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <iostream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <vector>

#include "cli/arguments.hpp"
#include "cli/broadphase_rows.hpp"
#include "cli/compiling.hpp"
#include "cli/output_file.hpp"
#include "cli/progress_bar.hpp"
#include "cli/recording.hpp"
#include "cli/simulation.hpp"
#include "cli/text.hpp"
#include "cli/verbs.hpp"
#include "scenes/box_world.hpp"
#include "scenes/broadphases.hpp"

namespace broadcl::cli {
namespace {

struct ReplayOptions {
  std::filesystem::path file;
  std::string broadphase = "auto";
  std::string device;
  std::optional<std::uint32_t> frames;
  std::string csv;
  std::string json;
  bool verify = false;
};

/// What must be known about the boxes before they are replayed.
struct Survey {
  float world_edge = 0;  ///< Edge of a cube around the origin that contains every finite bound.
  std::optional<std::string> first_empty;  ///< Frame and row of the first empty box, if there is one.
};

Survey survey(RecordingReader& recording, std::uint32_t frames) {
  // Bullet divides by the edge; far beyond these bounds it would overflow.
  constexpr float smallest = 1;
  constexpr float largest = 1e18F;
  float farthest = 0;
  Survey survey;
  for (std::uint32_t block = 0; block <= frames; ++block) {
    const std::span<const Aabb> boxes = recording.next();
    for (std::size_t row = 0; row < boxes.size(); ++row) {
      for (const std::array<float, 3>& corner : {boxes[row].lower, boxes[row].upper}) {
        for (const float bound : corner) {
          if (std::isfinite(bound)) farthest = std::max(farthest, std::abs(bound));
        }
      }
      if (!survey.first_empty && is_empty(boxes[row])) {
        survey.first_empty = "frame " + std::to_string(block) + ", row " + std::to_string(row);
      }
    }
  }
  recording.rewind();
  survey.world_edge = std::clamp(2 * farthest, smallest, largest);
  return survey;
}

bool is_bullets_own(const std::string& broadphase) {
  const std::vector<scenes::BroadphaseInfo> table = scenes::broadphases();
  return std::any_of(table.begin(), table.end(),
                     [&](const auto& info) { return info.name == broadphase && info.bullet; });
}

std::unique_ptr<btBroadphaseInterface> make_broadphase(const ReplayOptions& options, const Survey& survey,
                                                       std::uint32_t boxes) {
  // An unknown device is an error even if the broad phase runs on the host.
  if (!options.device.empty()) (void)select_device(options.device);
  if (survey.first_empty && is_bullets_own(options.broadphase)) {
    throw Error(quoted(options.file) + " has an empty box, whose min exceeds its max, at " +
                *survey.first_empty + " (both count from 0), and " + options.broadphase +
                " cannot handle empty boxes; use one of BroadCL's broad phases");
  }
  if (scenes::find_broadphase(options.broadphase).culls) {
    throw Error("a recording has boxes, but no shapes to cull; leave out '+culling'");
  }
  return scenes::make_broadphase({.name = options.broadphase,
                                  .device = options.device,
                                  .on_compile = announce_compiling,
                                  .objects = boxes,
                                  .world_edge = survey.world_edge});
}

SimulationResult replay(RecordingReader& recording, std::uint32_t frames, const ReplayOptions& options) {
  const std::unique_ptr<btBroadphaseInterface> broadphase =
      make_broadphase(options, survey(recording, frames), recording.boxes());
  scenes::BoxWorld world(*broadphase, recording.next());
  std::span<const Aabb> boxes;
  ProgressBar progress(frames);
  Frames measured{.count = frames,
                  .step = [&] { return world.step(boxes = recording.next()); },
                  .verify = {},
                  .ended = [&] { progress.advance(); }};
  if (options.verify) measured.verify = [&] { return world.verify(boxes); };
  return measure(measured, options.broadphase, *broadphase, false);
}

std::string heading(const ReplayOptions& options, const RecordingReader& recording, std::uint32_t frames) {
  return "recording     " + one_line(options.file.string()) + ", " + counted(recording.boxes(), "box") +
         ", " + counted(frames, "frame") + "\nbroad phase   " + options.broadphase + "\n";
}

nlohmann::ordered_json json_of(const ReplayOptions& options, const RecordingReader& recording,
                               std::uint32_t frames) {
  return {{"recording", options.file.string()},
          {"objects", recording.boxes()},
          {"frames", frames},
          {"broadphase", options.broadphase},
          {"device", options.device}};
}

/// Opens the file that an option names.
void open(std::optional<OutputFile>& out, const std::string& option, const std::string& file,
          const std::filesystem::path& recording) {
  if (file.empty()) return;
  std::error_code ignored;
  if (std::filesystem::equivalent(recording, file, ignored)) {
    throw Error(option + " names the recording itself; name another file");
  }
  out.emplace(file);
}

Exit run_replay(const ReplayOptions& options) {
  RecordingReader recording(options.file);
  const std::uint32_t frames = options.frames.value_or(recording.frames());
  if (frames > recording.frames()) {
    throw Error("--frames: " + quoted(options.file) + " has only " + counted(recording.frames(), "frame"));
  }
  std::optional<OutputFile> csv;
  std::optional<OutputFile> json;
  open(csv, "--csv", options.csv, options.file);
  open(json, "--json", options.json, options.file);
  refuse_same_file({{"--csv", csv ? &*csv : nullptr}, {"--json", json ? &*json : nullptr}});

  const SimulationResult result = replay(recording, frames, options);
  if (csv) csv->write(csv_report(result));
  if (json) json->write(json_report_of(json_of(options, recording, frames), result));
  if (csv) csv->commit();
  if (json) json->commit();
  std::cout
      << table_report_of(heading(options, recording, frames), options.broadphase, result)
      << "Update: setAabb() of every box; broad phase: calculateOverlappingPairs(); total: their sum.\n";
  return result.verdict && result.verdict->first_wrong_frame ? Exit::difference : Exit::success;
}

}  // namespace

Verb add_replay(CLI::App& program) {
  auto options = std::make_shared<ReplayOptions>();
  CLI::App* verb = program.add_subcommand("replay", "Time a broad phase on a recording of moving boxes");
  verb->add_option(
          "FILE", options->file,
          "A recording by 'broadcl simulate --record' or Broadmark (.aabbs), or a NumPy array (.npy) "
          "of shape (frames, n, 6): min x, y, z, max x, y, z; float32, or float64, which is rounded "
          "outward. The initial state comes first and is not timed")
      ->required()
      ->type_name("");
  add_name(*verb, "--broadphase", options->broadphase, "The broad phase to time; see below");
  add_device(*verb, options->device);
  add_optional_number(*verb, "--frames", options->frames, 1U,
                      std::uint32_t{std::numeric_limits<std::int32_t>::max()}, "Only the first N frames");
  verb->get_option("--frames")->default_str("all");
  add_file(*verb, "--csv", options->csv, "Write the times of each frame here");
  add_file(*verb, "--json", options->json, "Write the summary here");
  verb->add_flag("--verify", options->verify,
                 "Compare the pairs of each frame with the oracle; not part of the times");
  verb->footer(broadphase_rows());
  return {verb, [options] { return run_replay(*options); }};
}

}  // namespace broadcl::cli
