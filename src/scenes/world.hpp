#pragma once

#include <Eigen/Geometry>
#include <chrono>
#include <cstddef>
#include <memory>

#include "scenes/scenario.hpp"

class btBroadphaseInterface;
class btDiscreteDynamicsWorld;

namespace broadcl::scenes {

/// Wall-clock seconds of one frame, measured the same way for every broad phase: by two readings of the clock
/// for each of update, broad phase and total. measuring_overhead() tells what that
/// costs: most of it lies in the total, and one reading's share in each of the other two.
struct FrameTimes {
  std::chrono::steady_clock::time_point start;  ///< When the frame began; the other starts count from it.
  double update_start;
  /// btCollisionWorld::updateAabbs(): every object's box computed and handed to setAabb(). And before the
  /// step, objects that come and go added and removed; update_start is as if that ran right before.
  double update;
  double broad_phase_start;
  double broad_phase;  ///< btCollisionWorld::computeOverlappingPairs().
  double total;  ///< The exchange of objects and the whole stepSimulation(), collision response included.
};

/// Seconds that measuring adds to a frame: what the same calls take more where they are measured, in a world
/// without objects. 0.1 to 0.2 microseconds on CPUs of today.
[[nodiscard]] double measuring_overhead();

/// A Bullet rigid-body world in which a scenario is simulated: the objects, and six static walls around the
/// container. Default friction, restitution 0, mass = volume, sleeping on.
///
/// The walls are 20 m thick, or a quarter of the container's edge where that is more: at 50 g objects cross
/// several metres a frame, so they sink into a wall that far before it pushes them back.
class World {
 public:
  static constexpr std::size_t walls = 6;
  /// Edge of the cube that the container and its walls fill.
  [[nodiscard]] static float outer_edge(const Scenario& scenario);

  /// @param broadphase Not owned; must outlive the world.
  World(const Scenario::Config& config, btBroadphaseInterface& broadphase);
  ~World();
  World(const World&) = delete;
  World& operator=(const World&) = delete;
  World(World&&) = delete;
  World& operator=(World&&) = delete;

  /// Simulates one frame: the script's gravity, kicks and exchanges, then stepSimulation(1/30 s, 0), in which
  /// one broad phase runs.
  FrameTimes step();

  [[nodiscard]] const Scenario& scenario() const noexcept;
  /// For what this interface leaves out. The first six collision objects are the walls, then come the objects
  /// in order, until one is exchanged.
  [[nodiscard]] btDiscreteDynamicsWorld& bullet() noexcept;
  /// Number of pairs in the pair cache.
  [[nodiscard]] std::size_t pair_count() const;
  /// Centre of an object.
  [[nodiscard]] Eigen::Vector3f position(std::size_t object) const;
  /// Box of an object, as the broad phase has it.
  [[nodiscard]] Eigen::AlignedBox3f box(std::size_t object) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace broadcl::scenes
