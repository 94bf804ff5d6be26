#pragma once

#include <broadcl/aabb.hpp>
#include <cstdint>
#include <span>
#include <vector>

#include "scenes/recorded_frame.hpp"
#include "scenes/verify.hpp"
#include "scenes/world.hpp"

namespace broadcl::scenes {

/// Boxes in a broad phase and nothing else: no bodies, no collision response. Any two boxes whose groups and
/// masks allow it may form a pair; nothing else of a recording is known here.
class BoxWorld {
 public:
  /// @param broadphase Not owned; must outlive the world, and must have no other proxies.
  explicit BoxWorld(btBroadphaseInterface& broadphase) : broadphase_(broadphase) {}
  ~BoxWorld();
  BoxWorld(const BoxWorld&) = delete;
  BoxWorld& operator=(const BoxWorld&) = delete;
  BoxWorld(BoxWorld&&) = delete;
  BoxWorld& operator=(BoxWorld&&) = delete;

  /// Makes the proxies those of a frame: setAabb() for all boxes. A proxy whose filter changed is made anew,
  /// since Bullet's own broad phases expect that.
  void set(const RecordedFrame& frame);

  /// One frame: set(), then calculateOverlappingPairs().
  /// @return As World::step(), except that `update` is set() and `total` is the sum of `update` and
  /// `broad_phase`.
  FrameTimes step(const RecordedFrame& frame);

  /// Compares the pairs with the oracle's.
  /// @param boxes Those of the last step, without NaNs.
  [[nodiscard]] Difference verify(std::span<const Aabb> boxes);

 private:
  btBroadphaseProxy* create(const Aabb& box, const Filter& filter);
  void exchange(const RecordedFrame& frame);

  btBroadphaseInterface& broadphase_;
  std::vector<std::uint32_t> ids_;
  std::vector<btBroadphaseProxy*> proxies_;  // one per id
};

}  // namespace broadcl::scenes
