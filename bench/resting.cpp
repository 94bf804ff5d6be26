#include "benchmarks.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletCollision/CollisionDispatch/btCollisionDispatcher.h>
#include <BulletCollision/CollisionDispatch/btCollisionObject.h>
#include <BulletCollision/CollisionDispatch/btCollisionWorld.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>
#include <BulletCollision/CollisionShapes/btBoxShape.h>
#include <benchmark/benchmark.h>

#include "bounds.hpp"
#include "frame_times.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/remove_all_pairs.hpp"

namespace broadcl {
namespace {

using scenes::MovingBoxes;

class RestingWorld {
 public:
  RestingWorld(const std::string& name, std::uint32_t moving, std::uint32_t n)
      : boxes_(n, MovingBoxes::Sizes::uniform),
        stride_(n / moving),
        broadphase_(scenes::make_broadphase(
            {.name = name, .device = {}, .objects = n, .world_edge = 4 / boxes_.edge()})),
        objects_(n),
        world_(&dispatcher_, broadphase_.get(), &configuration_) {
    const std::vector<Bounds> bounds = scaled(boxes_);
    for (std::size_t k = 0; k < n; ++k) {
      objects_[k].setCollisionShape(&cube_);
      if (k % stride_ != 0) objects_[k].forceActivationState(ISLAND_SLEEPING);
      place(k, bounds[k]);
      world_.addCollisionObject(&objects_[k]);
    }
  }
  ~RestingWorld() { scenes::remove_all_pairs(*world_.getPairCache(), &dispatcher_); }
  RestingWorld(const RestingWorld&) = delete;
  RestingWorld& operator=(const RestingWorld&) = delete;
  RestingWorld(RestingWorld&&) = delete;
  RestingWorld& operator=(RestingWorld&&) = delete;

  void skip_resting() { world_.setForceUpdateAllAabbs(false); }
  void move() {
    boxes_.advance();
    const std::vector<Bounds> bounds = scaled(boxes_);
    for (std::size_t k = 0; k < objects_.size(); k += stride_) place(k, bounds[k]);
  }
  /// Returns the number of pairs.
  std::size_t update() {
    world_.updateAabbs();
    world_.computeOverlappingPairs();
    return static_cast<std::size_t>(world_.getPairCache()->getNumOverlappingPairs());
  }

 private:
  void place(std::size_t k, const Bounds& bounds) {
    objects_[k].getWorldTransform().setOrigin((bounds.lower + bounds.upper) / 2);
  }

  MovingBoxes boxes_;
  std::size_t stride_;
  btBoxShape cube_{btVector3(0.5F, 0.5F, 0.5F)};
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  std::unique_ptr<btBroadphaseInterface> broadphase_;
  std::vector<btCollisionObject> objects_;
  btCollisionWorld world_;  // destroyed first, since it needs everything above it
};

void time_resting(benchmark::State& state, const std::string& name, std::uint32_t moving, std::uint32_t n,
                  bool skip) {
  RestingWorld world(name, moving, n);
  if (skip) world.skip_resting();
  constexpr int first_frames = 8;  // until memory has grown
  for (int frame = 0; frame < first_frames; ++frame) {
    world.move();
    (void)world.update();
  }
  FrameTimes frames(state);
  std::size_t pairs = 0;
  for ([[maybe_unused]] auto _ : state) {
    world.move();
    frames.time([&] {
      pairs = world.update();
      return std::size_t{0};
    });
  }
  frames.report();
  state.counters["overlapping"] = static_cast<double>(pairs);
}

}  // namespace

/// Benchmarks of a Bullet world in which some objects move and the others sleep: updateAabbs() and
/// computeOverlappingPairs().
///
///   resting/NAME/MOVING/N        MOVING of N objects move by a tenth of their edge
///   resting/NAME/MOVING/N/skip   the same after setForceUpdateAllAabbs(false)
///
/// NAME is one of scenes::broadphases().
void register_resting() {
  for (const auto& [moving, n] : {std::pair(10U, 500U), {100U, 100U}, {100U, 10000U}, {1000U, 100000U}}) {
    for (const char* name : {"auto", "sweep-and-prune", "bullet-bvh"}) {
      for (const bool skip : {false, true}) {
        const std::string row = std::string("resting/") + name + "/" + std::to_string(moving) + "/" +
                                std::to_string(n) + (skip ? "/skip" : "");
        benchmark::RegisterBenchmark(row.c_str(), time_resting, name, moving, n, skip)
            ->UseManualTime()
            ->Iterations(256)
            ->Unit(benchmark::kMillisecond);
      }
    }
  }
}

}  // namespace broadcl
