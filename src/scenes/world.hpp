#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "scenes/scenario.hpp"

class btBroadphaseInterface;
class btDiscreteDynamicsWorld;

namespace broadcl::scenes {

/// CPU seconds of the thread that simulates, in the parts of a frame as FrameTimes has them.
struct CpuTimes {
  double update;
  double broad_phase;
  double total;
};

/// Wall-clock seconds of one frame, measured the same way for every broad phase: with two readings of each
/// clock for update, broad phase and total. The readings add about a microsecond to the total, and a tenth of
/// that to the other two.
struct FrameTimes {
  /// btCollisionWorld::updateAabbs(), which computes every object's box and passes it to setAabb(), plus the
  /// exchange of objects before the step.
  double update;
  double broad_phase;  ///< btCollisionWorld::computeOverlappingPairs().
  double total;  ///< The exchange of objects and the whole stepSimulation(), including collision response.
  CpuTimes cpu;
};

/// A Bullet rigid-body world that simulates a scenario: its objects, and six static walls around the
/// container. Default friction, restitution 0, mass = volume, sleeping on. Bullet's pools hold the contacts
/// of 16 pairs per object, of 4,096 to 262,144 in all.
///
/// The walls are 20 m thick, or a quarter of the container's edge if that is more: at 50 g objects travel
/// several metres per frame, and sink that far into a wall before it pushes them back.
///
/// With several threads, it consists of Bullet's classes for them, whose results depend on which thread is
/// faster, and Bullet's task scheduler is replaced while the world exists: only one such world at a time.
class World {
 public:
  static constexpr std::size_t walls = 6;
  static constexpr std::uint32_t most_threads = 64;
  /// Edge of the cube that contains the container and its walls.
  [[nodiscard]] static float outer_edge(const Scenario& scenario);

  /// @param broadphase Not owned; must outlive the world.
  /// @param threads From 1 to most_threads.
  /// @throws Error for several threads if Bullet or BroadCL was built without BT_THREADSAFE, or if there are
  /// more than the machine runs.
  World(const Scenario::Config& config, btBroadphaseInterface& broadphase, std::uint32_t threads = 1);
  ~World();
  World(const World&) = delete;
  World& operator=(const World&) = delete;
  World(World&&) = delete;
  World& operator=(World&&) = delete;

  /// Simulates one frame: the script's gravity, kicks and exchanges, then stepSimulation(1/30 s, 0), which
  /// runs the broad phase once.
  FrameTimes step();

  [[nodiscard]] const Scenario& scenario() const noexcept;
  /// Access to what this interface leaves out. The first six collision objects are the walls, followed by the
  /// objects in order, until the first exchange.
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
