#include <broadcl/version.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>
#include <cmath>
#include <cstdint>
#include <iostream>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/arguments.hpp"
#include "cli/compiling.hpp"
#include "cli/json.hpp"
#include "cli/operating_system.hpp"
#include "cli/output_file.hpp"
#include "cli/recording.hpp"
#include "cli/stopwatch.hpp"
#include "cli/text.hpp"
#include "cli/verbs.hpp"
#include "scenes/generators.hpp"
#include "scenes/recorded_objects.hpp"

namespace broadcl::cli {
namespace {

using scenes::BoxScene;

struct CheckOptions {
  std::string recording;
  std::string device;
  std::string report;
};

/// What an algorithm took, in seconds.
struct CheckTimes {
  double open = 0;    ///< Until it could be used, which includes compiling kernels.
  double scenes = 0;  ///< The updates of all scenes.
  double frames = 0;  ///< The updates of all frames of moving boxes.
};

/// An inverted box, which overlaps nothing, for a free id.
constexpr Aabb nowhere = {{1, 1, 1}, {-1, -1, -1}};

std::vector<Pair> oracle(const std::vector<Aabb>& boxes) {
  return overlapping_pairs(boxes, {}, {.algorithm = "oracle"});
}

/// What is wrong with a list of pairs; none if it is as expected.
std::optional<std::string> difference(const std::vector<Pair>& pairs, const std::vector<Pair>& expected) {
  if (pairs == expected) return std::nullopt;
  if (!std::is_sorted(pairs.begin(), pairs.end())) return "pairs out of order";
  std::vector<Pair> missing;
  std::vector<Pair> extra;
  std::set_difference(expected.begin(), expected.end(), pairs.begin(), pairs.end(),
                      std::back_inserter(missing));
  std::set_difference(pairs.begin(), pairs.end(), expected.begin(), expected.end(),
                      std::back_inserter(extra));
  const Pair& first = missing.empty() ? extra.front() : missing.front();
  return counted(missing.size(), "pair") + " missing, " + std::to_string(extra.size()) +
         " extra, the first (" + std::to_string(first.a) + ", " + std::to_string(first.b) + ")";
}

/// Applies a delta to a sorted list of pairs. False if it removes a missing pair or adds one that is there.
bool apply_delta(const Delta& delta, std::vector<Pair>& pairs) {
  if (!std::includes(pairs.begin(), pairs.end(), delta.removed.begin(), delta.removed.end())) return false;
  std::vector<Pair> kept;
  std::set_difference(pairs.begin(), pairs.end(), delta.removed.begin(), delta.removed.end(),
                      std::back_inserter(kept));
  pairs.clear();
  std::merge(kept.begin(), kept.end(), delta.added.begin(), delta.added.end(), std::back_inserter(pairs));
  return std::adjacent_find(pairs.begin(), pairs.end()) == pairs.end();
}

std::vector<BoxScene> still_scenes() {
  std::vector<BoxScene> scenes;
  for (const std::uint32_t count : {1U, 2U, 65U, 257U, 1000U, 3000U}) {
    const std::vector<BoxScene> more = scenes::box_scenes(count);
    scenes.insert(scenes.end(), more.begin(), more.end());
  }
  return scenes;
}

/// Runs all scenes on one broad phase: opening the device for each scene would take minutes on some devices.
std::optional<std::string> check_still(const std::vector<BoxScene>& scenes, const BroadPhase::Config& config,
                                       CheckTimes& times) {
  Stopwatch stopwatch;
  BroadPhase broad_phase(config);
  times.open = stopwatch.lap();
  for (const BoxScene& scene : scenes) {
    (void)stopwatch.lap();
    (void)broad_phase.update(scene.boxes);
    times.scenes += stopwatch.lap();
    if (const auto wrong = difference(broad_phase.pairs(), oracle(scene.boxes))) {
      return "scene '" + scene.name + "' of " + counted(scene.boxes.size(), "box") + ": " + *wrong;
    }
  }
  return std::nullopt;
}

/// What is wrong after an update; none if its pairs are as expected and its changes lead to them.
/// @param followed The pairs that all changes lead to.
std::optional<std::string> difference(const Delta& delta, const std::vector<Pair>& pairs,
                                      const std::vector<Pair>& expected, std::vector<Pair>& followed) {
  const bool applied = apply_delta(delta, followed);
  auto wrong = difference(pairs, expected);
  if (!wrong && (!applied || followed != pairs)) wrong = "the changes do not lead to its pairs";
  return wrong;
}

/// The frames of a recording.
template <class Box>
std::optional<std::string> check_recording(RecordingReader& recording, BroadPhase::Config config,
                                           CheckTimes& times) {
  config.distance = recording.distance();
  Stopwatch stopwatch;
  BasicBroadPhase<Box> broad_phase(config);
  times.open = stopwatch.lap();
  BasicBroadPhase<Box> oracle({.algorithm = "oracle", .distance = config.distance});
  std::vector<Pair> followed;
  recording.rewind();
  const std::uint32_t end = recording.frames() + (recording.has_initial_state() ? 1 : 0);
  for (std::uint32_t frame = 0; frame < end; ++frame) {
    const scenes::RecordedFrame& objects = recording.next();
    scenes::set_objects(oracle, objects);
    (void)oracle.update();
    scenes::set_objects(broad_phase, objects);
    (void)stopwatch.lap();
    const Delta delta = broad_phase.update();
    times.frames += stopwatch.lap();
    if (const auto wrong = difference(delta, broad_phase.pairs(), oracle.pairs(), followed))
      return "frame " + std::to_string(frame) + ": " + *wrong;
  }
  return std::nullopt;
}

/// Moving boxes, some of which leave and some of which come back in each frame.
std::optional<std::string> check_moving(unsigned frames, const BroadPhase::Config& config,
                                        CheckTimes& times) {
  constexpr std::uint32_t count = 500;
  constexpr std::uint32_t stride = 7;
  BroadPhase broad_phase(config);
  scenes::MovingBoxes scene(count, scenes::MovingBoxes::Sizes::mixed);
  std::vector<std::optional<std::uint32_t>> ids(count);
  std::vector<Pair> followed;
  for (unsigned frame = 0; frame < frames; ++frame) {
    std::vector<Aabb> boxes(count, nowhere);
    for (std::uint32_t i = 0; i < count; ++i) {
      const bool absent = i % stride == frame % stride;
      if (absent && ids[i]) broad_phase.remove(*std::exchange(ids[i], std::nullopt));
    }
    for (std::uint32_t i = 0; i < count; ++i) {
      const Aabb& box = scene.boxes()[i];
      if (ids[i]) broad_phase.move(*ids[i], box);
      if (!ids[i] && i % stride != frame % stride) ids[i] = broad_phase.add(box);
      if (ids[i]) boxes.at(*ids[i]) = box;
    }
    const std::string place = "frame " + std::to_string(frame) + " of moving boxes: ";
    Stopwatch stopwatch;
    const Delta delta = broad_phase.update();
    times.frames += stopwatch.lap();
    if (const auto wrong = difference(delta, broad_phase.pairs(), oracle(boxes), followed))
      return place + *wrong;
    scene.advance();
  }
  return std::nullopt;
}

/// The device to check; none if there is none, and none is named. `why_none` is the reason then.
std::optional<Device> find_device(const std::string& selector, std::string& why_none) {
  try {
    return select_device(selector);
  } catch (const Error& error) {
    if (!selector.empty() || !devices().empty()) throw;
    why_none = error.what();
    return device_for({});
  }
}

/// In milliseconds, to a thousandth.
nlohmann::ordered_json milliseconds_of(const CheckTimes& times) {
  const auto rounded = [](double seconds) { return std::round(seconds * 1e6) / 1e3; };
  return {
      {"open", rounded(times.open)}, {"scenes", rounded(times.scenes)}, {"frames", rounded(times.frames)}};
}

Exit run_check(const CheckOptions& options) {
  constexpr unsigned frames = 20;
  std::optional<RecordingReader> recording;
  if (!options.recording.empty()) {
    stop_recording();
    recording.emplace(options.recording);
  }
  std::optional<OutputFile> file;
  if (!options.report.empty()) file.emplace(options.report);
  std::string why_none;
  const std::optional<Device> device = find_device(options.device, why_none);
  auto report = nlohmann::ordered_json{{"versions", {{"broadcl", BROADCL_VERSION_STRING}}},
                                       {"system", operating_system()},
                                       {"device", nullptr},
                                       {"algorithms", nlohmann::ordered_json::array()}};
  if (recording) report["recording"] = options.recording;
  if (device) {
    report["device"] = json_of(*device);
  } else {
    report["why_no_device"] = why_none;
  }
  const std::vector<BoxScene> scenes = recording ? std::vector<BoxScene>() : still_scenes();
  const std::string right =
      "right in " + (recording ? counted(recording->frames(), "frame") + " of the recording"
                               : counted(scenes.size(), "scene") + " and " + counted(frames, "frame"));
  std::cout << (device ? one_line(device->label()) + " (" + device->id() + ")\n"
                       : "Only the algorithms of the host are checked: " + one_line(why_none) + "\n");
  bool works = true;
  // Those on the host first: the others may wait for a compiler.
  std::vector<AlgorithmInfo> all(algorithms().begin(), algorithms().end());
  std::stable_partition(all.begin(), all.end(),
                        [](const AlgorithmInfo& algorithm) { return !algorithm.on_device; });
  for (const AlgorithmInfo& algorithm : all) {
    if (!device && algorithm.on_device && algorithm.name != "auto") continue;
    const BroadPhase::Config config = {.device = device ? device->id() : "",
                                       .algorithm = std::string(algorithm.name),
                                       .on_compile = announce_compiling};
    std::optional<std::string> wrong;
    CheckTimes times;
    try {
      if (recording) {
        wrong = recording->is_double() ? check_recording<Aabb64>(*recording, config, times)
                                       : check_recording<Aabb>(*recording, config, times);
      } else {
        wrong = check_still(scenes, config, times);
        if (!wrong) wrong = check_moving(frames, config, times);
      }
    } catch (const Error& error) {
      wrong = error.what();
    }
    works = works && !wrong;
    std::cout << named_row(algorithm.name, wrong ? "WRONG: " + *wrong : right) << std::flush;
    report["algorithms"].push_back({{"name", algorithm.name},
                                    {"result", wrong.value_or("right")},
                                    {"milliseconds", milliseconds_of(times)}});
  }
  if (file) {
    file->write(text_of(report));
    file->commit();
  }
  if (recording) std::cout << recording->note_of_cut();
  std::cout << (works ? "BroadCL works here.\n" : "BroadCL does not work here.\n");
  return works ? Exit::success : Exit::difference;
}

}  // namespace

Verb add_check(CLI::App& program) {
  auto options = std::make_shared<CheckOptions>();
  CLI::App* verb = program.add_subcommand(
      "check", "Compare every algorithm on a device with the oracle, which is brute force on the host");
  verb->add_option("FILE", options->recording,
                   "A recording, as for 'broadcl replay', to be searched instead of built-in scenes")
      ->type_name("");
  add_device(*verb, options->device);
  add_file(*verb, "--report", options->report,
           "Write device, driver, versions, results and times here, as JSON");
  return {verb, [options] { return run_check(*options); }};
}

}  // namespace broadcl::cli
