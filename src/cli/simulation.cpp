#include "cli/simulation.hpp"

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletDynamics/Dynamics/btDiscreteDynamicsWorld.h>

#include <broadcl/bullet.hpp>
#include <memory>
#include <span>

#include "scenes/broadphases.hpp"
#include "scenes/verify.hpp"
#include "scenes/world.hpp"

namespace broadcl::cli {
namespace {

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

}  // namespace

SimulationResult simulate(const SimulationConfig& config, const std::function<void()>& frame_ended) {
  // An unknown device is an error even where the broad phase runs on the host.
  if (!config.device.empty()) (void)select_device(config.device);
  const std::unique_ptr<btBroadphaseInterface> broadphase = make_broadphase(config);
  scenes::World world(config.scenario, *broadphase);

  SimulationResult result;
  const BroadPhase* const core = core_of(*broadphase);
  result.device = device_of(core);
  if (config.verify) result.verdict.emplace().exact = is_exact(config.broadphase);
  for (std::uint32_t frame = 0; frame < config.frames; ++frame) {
    const scenes::FrameTimes times = world.step();
    add_times(result, times);
    result.stages.push_back(measures_stages(config) ? stages_of(core) : std::vector<Stage>());
    result.pairs.push_back(world.pair_count());
    if (result.verdict) add_frame(*result.verdict, frame, scenes::verify(world.bullet()));
    frame_ended();
  }
  return result;
}

}  // namespace broadcl::cli
