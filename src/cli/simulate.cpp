#include <CLI/CLI.hpp>
#include <algorithm>
#include <broadcl/error.hpp>
#include <cstdint>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/arguments.hpp"
#include "cli/broadphase_rows.hpp"
#include "cli/output_file.hpp"
#include "cli/progress_bar.hpp"
#include "cli/recording.hpp"
#include "cli/simulation.hpp"
#include "cli/verbs.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/scenario.hpp"
#include "scenes/world.hpp"

namespace broadcl::cli {
namespace {

struct SimulateOptions {
  SimulationConfig simulation;
  std::optional<std::vector<std::string>> broadphases;
  std::string csv;
  std::string json;
  std::string record;
  std::string svg;
};

Exit run_simulate(const SimulateOptions& options) {
  std::optional<OutputFile> csv;
  std::optional<OutputFile> json;
  std::optional<OutputFile> svg;
  std::optional<RecordingWriter> recording;
  if (!options.csv.empty()) csv.emplace(options.csv);
  if (!options.json.empty()) json.emplace(options.json);
  if (!options.svg.empty()) svg.emplace(options.svg);
  if (!options.record.empty()) recording.emplace(options.record, recording_info(options.simulation));
  refuse_same_file({{"--csv", csv ? &*csv : nullptr},
                    {"--json", json ? &*json : nullptr},
                    {"--svg", svg ? &*svg : nullptr},
                    {"--record", recording ? &recording->file() : nullptr}});

  const SimulationResult result = [&] {
    ProgressBar progress(options.simulation.frames);
    return simulate(
        options.simulation, [&] { progress.advance(); }, recording ? &*recording : nullptr);
  }();
  if (csv) csv->write(csv_report(result));
  if (json) json->write(json_report(options.simulation, result));
  if (svg) {
    svg->write(
        svg_report(scenario_line(options.simulation), {&options.simulation.broadphase, 1}, {&result, 1}));
  }
  if (recording) recording->commit();
  if (csv) csv->commit();
  if (json) json->commit();
  if (svg) svg->commit();
  std::cout << table_report(options.simulation, result);
  if (recording) {
    std::cout << "The recording contains the objects, but not the " << scenes::World::walls
              << " walls around them, so a replay lacks the pairs with the walls.\n";
  }
  return result.verdict && result.verdict->first_wrong_frame ? Exit::difference : Exit::success;
}

/// Simulates the same with one broad phase after the other.
Exit run_comparison(const SimulateOptions& options) {
  const std::vector<std::string>& names = *options.broadphases;
  const bool stores =
      !options.csv.empty() || !options.json.empty() || !options.record.empty() || options.simulation.profile;
  if (stores) {
    throw Error("--csv, --json, --record and --profile are for one broad phase; name one with --broadphase");
  }
  for (const std::string& name : names) (void)scenes::find_broadphase(name);
  std::optional<OutputFile> svg;
  if (!options.svg.empty()) svg.emplace(options.svg);
  std::vector<SimulationResult> results;
  {
    ProgressBar progress(std::uint64_t{options.simulation.frames} * names.size());
    SimulationConfig config = options.simulation;
    for (const std::string& name : names) {
      config.broadphase = name;
      results.push_back(simulate(config, [&] { progress.advance(); }));
    }
  }
  if (svg) {
    svg->write(svg_report(scenario_line(options.simulation), names, results));
    svg->commit();
  }
  std::cout << comparison_report(scenario_line(options.simulation), times_of_simulation, names, results);
  const bool wrong = std::any_of(results.begin(), results.end(), [](const SimulationResult& result) {
    return result.verdict && result.verdict->first_wrong_frame;
  });
  return wrong ? Exit::difference : Exit::success;
}

std::string simulate_footer() {
  std::string text = "Scenarios:\n";
  for (const scenes::ScenarioInfo& scenario : scenes::Scenario::list()) {
    text += named_row(scenario.name, scenario.summary);
  }
  return text + broadphase_rows() +
         "With '+culling' after the name of one of BroadCL's broad phases, pairs whose shapes do not "
         "overlap are kept from the narrow phase.\n";
}

}  // namespace

Verb add_simulate(CLI::App& program) {
  auto options = std::make_shared<SimulateOptions>();
  SimulationConfig& simulation = options->simulation;
  CLI::App* verb =
      program.add_subcommand("simulate", "Simulate a scenario in a Bullet world and time its frames");
  add_name(*verb, "--scenario", simulation.scenario.name, "The scenario to simulate; see below");
  add_number(*verb, "--objects", simulation.scenario.objects, 1U, most_objects, "Number of objects");
  add_number(*verb, "--frames", simulation.frames, 1U, most_frames, "Number of frames, of 1/30 s each");
  add_number(*verb, "--seed", simulation.scenario.seed, std::uint64_t{0}, UINT64_MAX,
             "Seed of the random numbers");
  verb->add_flag("--spheres", simulation.scenario.spheres, "Spheres instead of cubes");
  add_list(
      *verb, "--broadphase", options->broadphases, "A,B", [](const std::string& name) { return name; },
      "The broad phase, or several, to be compared with the first; see below")
      ->default_str(simulation.broadphase);
  add_device(*verb, simulation.device);
  add_number(
      *verb, "--threads", simulation.threads, 1U, scenes::World::most_threads,
      "Number of threads that simulate, in Bullet's multithreaded classes; more than 1 needs a Bullet that "
      "was built with threads");
  add_file(*verb, "--csv", options->csv, "Write the times of each frame here");
  add_file(*verb, "--json", options->json, "Write the summary here");
  add_file(
      *verb, "--record", options->record,
      "Write the boxes of all objects here, initially and after each frame, for 'broadcl replay': .aabbs "
      "or .npy, shape (1 + frames, objects, 6)");
  add_file(*verb, "--svg", options->svg, "Draw the times of the broad phases here, as an SVG");
  verb->add_flag("--profile", simulation.profile,
                 "Report the stages of the broad phase; this also measures device times, which "
                 "costs a few microseconds per frame");
  verb->add_flag("--verify", simulation.verify,
                 "Compare the pairs of each frame with the oracle; not part of the times");
  verb->footer(simulate_footer());
  return {verb, [options] {
            if (!options->broadphases) return run_simulate(*options);
            if (options->broadphases->size() > 1) return run_comparison(*options);
            options->simulation.broadphase = options->broadphases->front();
            return run_simulate(*options);
          }};
}

}  // namespace broadcl::cli
