#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>
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
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "cli/arguments.hpp"
#include "cli/broadphase_rows.hpp"
#include "cli/compiling.hpp"
#include "cli/operating_system.hpp"
#include "cli/output_file.hpp"
#include "cli/progress_bar.hpp"
#include "cli/recording.hpp"
#include "cli/simulation.hpp"
#include "cli/text.hpp"
#include "cli/verbs.hpp"
#include "scenes/box_world.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/recorded_objects.hpp"
#include "scenes/timed_frame.hpp"
#include "scenes/verify.hpp"

namespace broadcl::cli {
namespace {

struct ReplayOptions {
  std::filesystem::path file;
  std::optional<std::vector<std::string>> broadphases;
  std::string device;
  std::optional<std::uint32_t> frames;
  std::string csv;
  std::string json;
  bool verify = false;
};

/// What must be known about the boxes before they are replayed.
struct Survey {
  float world_edge = 0;  ///< Edge of a cube around the origin that contains every finite bound.
  std::optional<std::string> first_empty;    ///< Frame and row of the first empty box, if there is one.
  std::optional<std::string> beyond_bullet;  ///< What the recording has that Bullet does not know, if any.
};

/// What a frame has that Bullet's broad phases do not know.
std::optional<std::string> beyond_bullet(const scenes::RecordedFrame& frame) {
  for (const auto& [id, filter] : frame.filters) {
    if (filter.body != Filter::no_body) return "bodies";
    if (filter.world != Filter().world) return "worlds";
  }
  if (!frame.reaches.empty()) return "reaches";
  if (frame.exclusions && !frame.exclusions->empty()) return "exclusions";
  return std::nullopt;
}

Survey survey(RecordingReader& recording, std::uint32_t frames) {
  // Bullet divides by the edge; far beyond these bounds it would overflow.
  constexpr float smallest = 1;
  constexpr float largest = 1e18F;
  float farthest = 0;
  Survey survey;
  if (recording.is_double()) survey.beyond_bullet = "boxes in double precision";
  if (recording.distance() > 0) survey.beyond_bullet = "a distance";
  for (std::uint32_t k = recording.has_initial_state() ? 0 : 1; k <= frames; ++k) {
    const scenes::RecordedFrame& frame = recording.next();
    if (!survey.beyond_bullet) survey.beyond_bullet = beyond_bullet(frame);
    for (std::size_t row = 0; row < frame.boxes.size(); ++row) {
      for (const std::array<float, 3>& corner : {frame.boxes[row].lower, frame.boxes[row].upper}) {
        for (const float bound : corner) {
          if (std::isfinite(bound)) farthest = std::max(farthest, std::abs(bound));
        }
      }
      if (!survey.first_empty && is_empty(frame.boxes[row])) {
        survey.first_empty = "frame " + std::to_string(recording.has_initial_state() ? k : k - 1) + ", row " +
                             std::to_string(row);
      }
    }
  }
  recording.rewind();
  survey.world_edge = std::clamp(2 * farthest, smallest, largest);
  return survey;
}

/// @throws Error if a broad phase cannot replay the recording.
void refuse_unfit(const std::string& name, const ReplayOptions& options, const Survey& survey) {
  const scenes::BroadphaseInfo info = scenes::find_broadphase(name);
  if (info.culls) throw Error("a recording has boxes, but no shapes to cull; leave out '+culling'");
  if (info.bullet && survey.first_empty) {
    throw Error(quoted(options.file) + " has an empty box, whose min exceeds its max, at " +
                *survey.first_empty + " (both count from 0), and " + name +
                " cannot handle empty boxes; use one of BroadCL's broad phases");
  }
  if (info.bullet && survey.beyond_bullet) {
    throw Error(quoted(options.file) + " has " + *survey.beyond_bullet + ", which " + name +
                " does not know; use one of BroadCL's broad phases");
  }
}

/// Replays with a broad phase of Bullet's interface.
SimulationResult replay_in_bullet(RecordingReader& recording, Frames frames, const ReplayOptions& options,
                                  const std::string& name, const Survey& survey) {
  const auto broadphase = scenes::make_broadphase({.name = name,
                                                   .device = options.device,
                                                   .on_compile = announce_compiling,
                                                   .objects = std::max(recording.boxes(), 1U),
                                                   .world_edge = survey.world_edge});
  scenes::BoxWorld world(*broadphase);
  if (recording.has_initial_state()) world.set(recording.next());
  const scenes::RecordedFrame* frame = nullptr;
  frames.step = [&] { return world.step(*(frame = &recording.next())); };
  if (options.verify) frames.verify = [&] { return world.verify(frame->boxes); };
  return measure(frames, name, *broadphase, false);
}

/// Replays what Bullet does not know.
template <class Box>
SimulationResult replay_directly(RecordingReader& recording, Frames frames, const ReplayOptions& options,
                                 const std::string& name) {
  const Config config{.device = options.device,
                      .algorithm = name,
                      .distance = recording.distance(),
                      .on_compile = announce_compiling};
  BasicBroadPhase<Box> broad_phase(config);
  BasicBroadPhase<Box> oracle({.algorithm = "oracle", .distance = recording.distance()});
  const scenes::RecordedFrame* frame = nullptr;
  std::size_t pairs = 0;
  frames.step = [&] {
    frame = &recording.next();
    return scenes::timed_frame([&] { scenes::set_objects(broad_phase, *frame); },
                               [&] {
                                 const Delta delta = broad_phase.update();
                                 pairs += delta.added.size() - delta.removed.size();
                               });
  };
  if (options.verify) {
    frames.verify = [&] {
      scenes::set_objects(oracle, *frame);
      (void)oracle.update();
      return scenes::difference(broad_phase.pairs(), oracle.pairs());
    };
  }
  const auto device = [&]() -> std::optional<Device> {
    return broad_phase.device() != nullptr ? std::optional(*broad_phase.device()) : std::nullopt;
  };
  return measure(frames, true, {.pairs = [&] { return pairs; }, .device = device});
}

/// Replays with one broad phase after the other.
std::vector<SimulationResult> replay(RecordingReader& recording, std::uint32_t frames,
                                     const ReplayOptions& options, const Survey& survey) {
  std::vector<SimulationResult> results;
  ProgressBar progress(std::uint64_t{frames} * options.broadphases->size());
  for (const std::string& name : *options.broadphases) {
    const Frames measured{.count = frames, .step = {}, .verify = {}, .ended = [&] { progress.advance(); }};
    recording.rewind();
    if (!survey.beyond_bullet) {
      results.push_back(replay_in_bullet(recording, measured, options, name, survey));
    } else if (recording.is_double()) {
      results.push_back(replay_directly<Aabb64>(recording, measured, options, name));
    } else {
      results.push_back(replay_directly<Aabb>(recording, measured, options, name));
    }
  }
  return results;
}

std::string heading(const ReplayOptions& options, const RecordingReader& recording, std::uint32_t frames) {
  return "recording     " + one_line(options.file.string()) + ", " +
         (recording.has_initial_state() ? "" : "at most ") + counted(recording.boxes(), "box") +
         (recording.is_double() ? " in double precision, " : ", ") + counted(frames, "frame") + "\n";
}

nlohmann::ordered_json json_of(const ReplayOptions& options, const RecordingReader& recording,
                               std::uint32_t frames) {
  return {{"recording", options.file.string()},
          {"objects", recording.boxes()},
          {"frames", frames},
          {"broadphase", options.broadphases->front()},
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
  stop_recording();
  RecordingReader recording(options.file);
  const std::uint32_t frames = options.frames.value_or(recording.frames());
  if (frames > recording.frames()) {
    throw Error("--frames: " + quoted(options.file) + " has only " + counted(recording.frames(), "frame"));
  }
  const std::vector<std::string>& names = *options.broadphases;
  if (names.size() > 1 && !(options.csv.empty() && options.json.empty()))
    throw Error("--csv and --json are for one broad phase; name one with --broadphase");
  std::optional<OutputFile> csv;
  std::optional<OutputFile> json;
  open(csv, "--csv", options.csv, options.file);
  open(json, "--json", options.json, options.file);
  refuse_same_file({{"--csv", csv ? &*csv : nullptr}, {"--json", json ? &*json : nullptr}});

  const Survey survey = cli::survey(recording, frames);
  // An unknown device is an error even if the broad phase runs on the host.
  if (!options.device.empty()) (void)select_device(options.device);
  for (const std::string& name : names) refuse_unfit(name, options, survey);
  const std::vector<SimulationResult> results = replay(recording, frames, options, survey);
  if (csv) csv->write(csv_report(results.front()));
  if (json) json->write(json_report_of(json_of(options, recording, frames), results.front()));
  if (csv) csv->commit();
  if (json) json->commit();
  const std::string_view explained =
      survey.beyond_bullet
          ? "Update: the calls that set boxes and what else changed; broad phase: update(); total: their "
            "sum.\n"
          : "Update: setAabb() of every box; broad phase: calculateOverlappingPairs(); total: their sum.\n";
  const std::string of_recording = heading(options, recording, frames);
  if (names.size() > 1) {
    std::cout << comparison_report(of_recording, explained, names, results);
  } else {
    std::cout << table_report_of(of_recording + "broad phase   " + names.front() + "\n", names.front(),
                                 results.front())
              << explained;
  }
  std::cout << recording.note_of_cut();
  const bool wrong = std::ranges::any_of(results, [](const SimulationResult& result) {
    return result.verdict && result.verdict->first_wrong_frame;
  });
  return wrong ? Exit::difference : Exit::success;
}

}  // namespace

Verb add_replay(CLI::App& program) {
  auto options = std::make_shared<ReplayOptions>();
  options->broadphases = {"auto"};
  CLI::App* verb = program.add_subcommand("replay", "Time broad phases on a recording of moving boxes");
  verb->add_option(
          "FILE", options->file,
          "What a program wrote that ran with BROADCL_RECORD=FILE; a recording by 'broadcl simulate "
          "--record' "
          "or Broadmark (.aabbs); or a NumPy array (.npy) of shape (frames, n, 6): min x, y, z, max x, y, z; "
          "float32, or float64, which is rounded outward. In the last three, the initial state comes first "
          "and is not timed")
      ->required()
      ->type_name("");
  add_list(
      *verb, "--broadphase", options->broadphases, "A,B", [](const std::string& name) { return name; },
      "The broad phase to time, or several, to be compared with the first; see below")
      ->default_str(options->broadphases->front());
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
