#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletDynamics/Dynamics/btDiscreteDynamicsWorld.h>

#include <CLI/CLI.hpp>
#include <broadcl/bullet.hpp>
#include <cstddef>
#include <cstdint>
#include <iostream>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "cli/arguments.hpp"
#include "cli/output_file.hpp"
#include "cli/progress_bar.hpp"
#include "cli/simulation.hpp"
#include "cli/trace.hpp"
#include "cli/verbs.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/verify.hpp"
#include "scenes/world.hpp"

namespace broadcl::cli {
namespace {

struct Options {
  SimulationConfig simulation;
  std::string csv;
  std::string json;
  std::string trace;
};

bool measures_stages(const SimulationConfig& config) {
  return config.profile || config.trace;
}

std::unique_ptr<btBroadphaseInterface> make_broadphase(const SimulationConfig& config) {
  return scenes::make_broadphase(
      {.name = config.broadphase,
       .device = config.device,
       .profile = measures_stages(config),
       .objects = config.scenario.objects + scenes::World::walls,
       .world_edge = scenes::World::outer_edge(scenes::Scenario(config.scenario))});
}

/// What is underneath; null for Bullet's own broad phases.
const BroadPhase* core_of(const btBroadphaseInterface& broadphase) {
  const auto* own = dynamic_cast<const BulletBroadphase*>(&broadphase);
  return own != nullptr ? &own->broad_phase() : nullptr;
}

std::optional<Device> device_of(const BroadPhase* core) {
  const Device* device = core != nullptr ? core->device() : nullptr;
  return device != nullptr ? std::optional(*device) : std::nullopt;
}

std::vector<Stage> stages_of(const BroadPhase* core) {
  if (core == nullptr) return {};
  const std::span<const Stage> stages = core->profile();
  return {stages.begin(), stages.end()};
}

void add_times(SimulationResult& result, const scenes::FrameTimes& times) {
  result.start.push_back(times.start);
  result.update_start.push_back(times.update_start * 1e3);
  result.update.push_back(times.update * 1e3);
  result.broad_phase_start.push_back(times.broad_phase_start * 1e3);
  result.broad_phase.push_back(times.broad_phase * 1e3);
  result.total.push_back(times.total * 1e3);
}

bool is_exact(const std::string& broadphase) {
  for (const scenes::BroadphaseInfo& info : scenes::broadphases()) {
    if (info.name == broadphase) return info.exact;
  }
  return false;
}

void add_frame(Verdict& verdict, std::uint32_t frame, const scenes::Difference& difference) {
  verdict.missing += difference.missing;
  verdict.extra += difference.extra;
  const bool wrong = difference.missing > 0 || (verdict.exact && difference.extra > 0);
  if (wrong && !verdict.first_wrong_frame) verdict.first_wrong_frame = frame;
}

SimulationResult simulate(const SimulationConfig& config) {
  // An unknown device is an error even where the broad phase runs on the host.
  if (!config.device.empty()) (void)select_device(config.device);
  const std::unique_ptr<btBroadphaseInterface> broadphase = make_broadphase(config);
  scenes::World world(config.scenario, *broadphase);

  SimulationResult result;
  const BroadPhase* const core = core_of(*broadphase);
  result.device = device_of(core);
  if (config.verify) result.verdict.emplace().exact = is_exact(config.broadphase);
  ProgressBar progress(config.frames);
  for (std::uint32_t frame = 0; frame < config.frames; ++frame) {
    const scenes::FrameTimes times = world.step();
    add_times(result, times);
    result.stages.push_back(measures_stages(config) ? stages_of(core) : std::vector<Stage>());
    result.pairs.push_back(world.pair_count());
    if (result.verdict) add_frame(*result.verdict, frame, scenes::verify(world.bullet()));
    progress.advance();
  }
  return result;
}

void refuse_same_file(const std::string& name, const std::optional<OutputFile>& file,
                      const std::string& other_name, const std::optional<OutputFile>& other) {
  if (file && other && file->target() == other->target()) {
    throw Error(name + " and " + other_name + " name the same file");
  }
}

Exit run(const Options& options) {
  std::optional<OutputFile> csv;
  std::optional<OutputFile> json;
  std::optional<OutputFile> trace;
  if (!options.csv.empty()) csv.emplace(options.csv);
  if (!options.json.empty()) json.emplace(options.json);
  if (!options.trace.empty()) trace.emplace(options.trace);
  refuse_same_file("--csv", csv, "--json", json);
  refuse_same_file("--csv", csv, "--trace", trace);
  refuse_same_file("--json", json, "--trace", trace);

  const SimulationResult result = simulate(options.simulation);
  if (csv) csv->write(csv_report(result));
  if (json) json->write(json_report(options.simulation, result));
  if (trace) write_trace(*trace, options.simulation, result);
  if (csv) csv->commit();
  if (json) json->commit();
  if (trace) trace->commit();
  std::cout << table_report(options.simulation, result);
  return result.verdict && result.verdict->first_wrong_frame ? Exit::difference : Exit::success;
}

std::string footer() {
  std::string text = "Scenarios:\n";
  for (const scenes::ScenarioInfo& scenario : scenes::Scenario::list()) {
    text += named_row(scenario.name, scenario.summary);
  }
  text += "Broad phases:\n";
  for (const scenes::BroadphaseInfo& info : scenes::broadphases()) text += named_row(info.name, info.summary);
  return text;
}

}  // namespace

Verb add_simulate(CLI::App& program) {
  constexpr std::uint32_t most_objects = 1'000'000;
  constexpr std::uint32_t most_frames = 10'000'000;
  auto options = std::make_shared<Options>();
  SimulationConfig& simulation = options->simulation;
  CLI::App* verb =
      program.add_subcommand("simulate", "Simulate a scenario in a Bullet world and time its frames");
  add_name(*verb, "--scenario", simulation.scenario.name, "What is simulated; see below");
  add_number(*verb, "--objects", simulation.scenario.objects, 1U, most_objects, "Number of objects");
  add_number(*verb, "--frames", simulation.frames, 1U, most_frames, "Number of frames, of 1/30 s each");
  add_number(*verb, "--seed", simulation.scenario.seed, std::uint64_t{0}, UINT64_MAX,
             "Seed of the random numbers");
  verb->add_flag("--spheres", simulation.scenario.spheres, "Spheres in place of cubes");
  add_name(*verb, "--broadphase", simulation.broadphase, "The broad phase of the world; see below");
  add_device(*verb, simulation.device);
  verb->add_option("--csv", options->csv, "Where to write the times of each frame")->type_name("FILE");
  verb->add_option("--json", options->json, "Where to write the summary")->type_name("FILE");
  verb->add_option("--trace", options->trace,
                   "Where to write a trace of all frames, for ui.perfetto.dev and chrome://tracing; measures "
                   "as --profile does")
      ->type_name("FILE");
  verb->add_flag("--profile", simulation.profile,
                 "Report the stages of the broad phase; device times are measured then, which "
                 "costs a few microseconds a frame");
  verb->add_flag("--verify", simulation.verify,
                 "Compare the pairs of each frame with the oracle, off the clock");
  verb->footer(footer());
  return {verb, [options] {
            options->simulation.trace = !options->trace.empty();
            return run(*options);
          }};
}

}  // namespace broadcl::cli
