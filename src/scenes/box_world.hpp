#pragma once

#include <broadcl/aabb.hpp>
#include <span>
#include <vector>

#include "scenes/verify.hpp"
#include "scenes/world.hpp"

namespace broadcl::scenes {

/// Boxes in a broad phase and nothing else: no bodies, no collision response. Any two boxes may form a pair.
class BoxWorld {
 public:
  /// Creates one proxy per box.
  /// @param broadphase Not owned; must outlive the world, and must have no other proxies.
  BoxWorld(btBroadphaseInterface& broadphase, std::span<const Aabb> boxes);
  ~BoxWorld();
  BoxWorld(const BoxWorld&) = delete;
  BoxWorld& operator=(const BoxWorld&) = delete;
  BoxWorld(BoxWorld&&) = delete;
  BoxWorld& operator=(BoxWorld&&) = delete;

  /// One frame: setAabb() for all boxes, then calculateOverlappingPairs().
  /// @param boxes As many as the world was made with, in the same order.
  /// @return As World::step(), except that `update` is the calls of setAabb() and `total` is the sum of
  /// `update` and `broad_phase`.
  FrameTimes step(std::span<const Aabb> boxes);

  /// Compares the pairs with the oracle's.
  /// @param boxes Those of the last step, without NaNs.
  [[nodiscard]] Difference verify(std::span<const Aabb> boxes);

 private:
  btBroadphaseInterface& broadphase_;
  std::vector<btBroadphaseProxy*> proxies_;
};

}  // namespace broadcl::scenes
