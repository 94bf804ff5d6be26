#include "scenes/box_world.hpp"

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>

#include <array>
#include <chrono>
#include <cstddef>

#include "scenes/remove_all_pairs.hpp"
#include "scenes/thread_time.hpp"

namespace broadcl::scenes {
namespace {

btVector3 to_bullet(const std::array<float, 3>& corner) {
  return {corner[0], corner[1], corner[2]};
}

}  // namespace

BoxWorld::BoxWorld(btBroadphaseInterface& broadphase, std::span<const Aabb> boxes) : broadphase_(broadphase) {
  proxies_.reserve(boxes.size());
  void* const owner = this;  // btSimpleBroadphase skips proxies that have no client object
  for (const Aabb& box : boxes) {
    proxies_.push_back(broadphase.createProxy(to_bullet(box.lower), to_bullet(box.upper), 0, owner,
                                              btBroadphaseProxy::DefaultFilter, btBroadphaseProxy::AllFilter,
                                              nullptr));
  }
}

BoxWorld::~BoxWorld() {
  remove_all_pairs(*broadphase_.getOverlappingPairCache(), nullptr);
  for (btBroadphaseProxy* proxy : proxies_) broadphase_.destroyProxy(proxy, nullptr);
}

FrameTimes BoxWorld::step(std::span<const Aabb> boxes) {
  using Clock = std::chrono::steady_clock;
  const double cpu_begin = thread_seconds();
  const Clock::time_point begin = Clock::now();
  for (std::size_t k = 0; k < proxies_.size(); ++k) {
    broadphase_.setAabb(proxies_[k], to_bullet(boxes[k].lower), to_bullet(boxes[k].upper), nullptr);
  }
  const Clock::time_point updated = Clock::now();
  const double cpu_updated = thread_seconds();
  const Clock::time_point search = Clock::now();
  broadphase_.calculateOverlappingPairs(nullptr);
  const Clock::time_point end = Clock::now();
  const std::chrono::duration<double> update = updated - begin;
  const std::chrono::duration<double> broad_phase = end - search;
  const double cpu_end = thread_seconds();
  return {.update = update.count(),
          .broad_phase = broad_phase.count(),
          .total = update.count() + broad_phase.count(),
          .cpu = {.update = cpu_updated - cpu_begin,
                  .broad_phase = cpu_end - cpu_updated,
                  .total = cpu_end - cpu_begin}};
}

Difference BoxWorld::verify(std::span<const Aabb> boxes) {
  return scenes::verify(*broadphase_.getOverlappingPairCache(), proxies_, boxes);
}

}  // namespace broadcl::scenes
