#include "cli/simulation.hpp"
#include "cli/compiling.hpp"

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletDynamics/Dynamics/btDiscreteDynamicsWorld.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>
#include <memory>
#include <span>

#include "scenes/broadphases.hpp"

namespace broadcl::cli {
namespace {

std::unique_ptr<btBroadphaseInterface> make_broadphase(const SimulationConfig& config) {
  return scenes::make_broadphase(
      {.name = config.broadphase,
       .device = config.device,
       .profile = config.profile,
       .on_compile = announce_compiling,
       .objects = config.scenario.objects + scenes::World::walls,
       .world_edge = scenes::World::outer_edge(scenes::Scenario(config.scenario))});
}

/// The last error that the broad phase reports from now on; empty while there is none.
std::shared_ptr<const std::string> watch_errors(btBroadphaseInterface& broadphase) {
  auto last_error = std::make_shared<std::string>();
  if (auto* own = dynamic_cast<BulletBroadphase*>(&broadphase)) {
    own->set_error_handler([last_error](const std::string& error) { *last_error = error; });
  }
  return last_error;
}

/// The core under the adapter; null for Bullet's own broad phases.
const BroadPhase* core_of(const btBroadphaseInterface& broadphase) {
  const auto* own = dynamic_cast<const BulletBroadphase*>(&broadphase);
  return own != nullptr ? &own->broad_phase() : nullptr;
}

std::optional<Device> device_of(const BroadPhase* core) {
  const Device* device = core != nullptr ? core->device() : nullptr;
  return device != nullptr ? std::optional(*device) : std::nullopt;
}

std::vector<Aabb> boxes_of(const scenes::World& world) {
  const std::size_t objects = world.scenario().objects().size();
  std::vector<Aabb> boxes;
  boxes.reserve(objects);
  for (std::size_t k = 0; k < objects; ++k) {
    const Eigen::AlignedBox3f box = world.box(k);
    boxes.push_back(
        {{box.min().x(), box.min().y(), box.min().z()}, {box.max().x(), box.max().y(), box.max().z()}});
  }
  return boxes;
}

std::vector<Stage> stages_of(const BroadPhase* core) {
  if (core == nullptr) return {};
  const std::span<const Stage> stages = core->profile();
  return {stages.begin(), stages.end()};
}

void add_times(SimulationResult& result, const scenes::FrameTimes& times) {
  result.update.push_back(times.update * 1e3);
  result.broad_phase.push_back(times.broad_phase * 1e3);
  result.total.push_back(times.total * 1e3);
  result.cpu.update.push_back(times.cpu.update * 1e3);
  result.cpu.broad_phase.push_back(times.cpu.broad_phase * 1e3);
  result.cpu.total.push_back(times.cpu.total * 1e3);
}

void add_frame(Verdict& verdict, std::uint32_t frame, const scenes::Difference& difference) {
  verdict.missing += difference.missing;
  verdict.extra += difference.extra;
  const bool wrong = difference.missing > 0 || (verdict.exact && difference.extra > 0);
  if (wrong && !verdict.first_wrong_frame) verdict.first_wrong_frame = frame;
}

}  // namespace

SimulationResult measure(const Frames& frames, bool exact, const BroadPhaseReports& reports) {
  SimulationResult result;
  if (frames.verify) result.verdict.emplace().exact = exact;
  for (std::uint32_t frame = 0; frame < frames.count; ++frame) {
    const scenes::FrameTimes times = frames.step();
    if (const std::string error = reports.error ? reports.error() : ""; !error.empty()) {
      throw Error("stopped in frame " + std::to_string(frame) + ", when the broad phase reported: " + error);
    }
    add_times(result, times);
    result.stages.push_back(reports.stages ? reports.stages() : std::vector<Stage>());
    result.pairs.push_back(reports.pairs());
    if (result.verdict) add_frame(*result.verdict, frame, frames.verify());
    frames.ended();
  }
  result.device = reports.device();
  return result;
}

SimulationResult measure(const Frames& frames, const std::string& name, btBroadphaseInterface& broadphase,
                         bool stages) {
  const std::shared_ptr<const std::string> last_error = watch_errors(broadphase);
  const BroadPhase* const core = core_of(broadphase);
  const btOverlappingPairCache& cache = *broadphase.getOverlappingPairCache();
  BroadPhaseReports reports{.pairs = [&] { return static_cast<std::size_t>(cache.getNumOverlappingPairs()); },
                            .device = [&] { return device_of(core); },
                            .error = [&] { return *last_error; }};
  if (stages) reports.stages = [&] { return stages_of(core); };
  return measure(frames, scenes::find_broadphase(name).exact, reports);
}

SimulationResult simulate(const SimulationConfig& config, const std::function<void()>& frame_ended,
                          RecordingWriter* recording) {
  // An unknown device is an error even if the broad phase runs on the host.
  if (!config.device.empty()) (void)select_device(config.device);
  const std::unique_ptr<btBroadphaseInterface> broadphase = make_broadphase(config);
  scenes::World world(config.scenario, *broadphase, config.threads);
  if (scenes::find_broadphase(config.broadphase).culls) {
    dynamic_cast<BulletBroadphase&>(*broadphase).set_shape_culling(&world.bullet());
  }

  const auto record = [&] {
    if (recording != nullptr) recording->write(boxes_of(world));
  };
  Frames frames{.count = config.frames,
                .step = [&] { return world.step(); },
                .verify = {},
                .ended =
                    [&] {
                      record();
                      frame_ended();
                    }};
  if (config.verify) frames.verify = [&] { return scenes::verify(world.bullet()); };
  record();
  return measure(frames, config.broadphase, *broadphase, config.profile);
}

RecordingInfo recording_info(const SimulationConfig& config) {
  const float edge = scenes::World::outer_edge(scenes::Scenario(config.scenario)) / 2;
  return {.scene = config.scenario.name,
          .objects = config.scenario.spheres ? "spheres" : "cubes",
          .world = {{-edge, -edge, -edge}, {edge, edge, edge}},
          .boxes = config.scenario.objects,
          .frames = config.frames};
}

}  // namespace broadcl::cli
