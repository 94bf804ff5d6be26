#pragma once

#include <broadcl/aabb.hpp>
#include <span>
#include <vector>

#include "scenes/verify.hpp"
#include "scenes/world.hpp"

namespace broadcl::scenes {

/// Boxes on a broad phase and nothing else: no bodies, no collision response. All may pair with all.
class BoxWorld {
 public:
  /// Makes a proxy a box.
  /// @param broadphase Not owned; must outlive the world, and nobody else may have proxies in it.
  BoxWorld(btBroadphaseInterface& broadphase, std::span<const Aabb> boxes);
  ~BoxWorld();
  BoxWorld(const BoxWorld&) = delete;
  BoxWorld& operator=(const BoxWorld&) = delete;
  BoxWorld(BoxWorld&&) = delete;
  BoxWorld& operator=(BoxWorld&&) = delete;

  /// One frame: setAabb() for all boxes, then calculateOverlappingPairs().
  /// @param boxes As many as the world was made of, in their order.
  /// @return What a World measures, but `update` is the calls of setAabb(), and `total` is `update` and
  /// `broad_phase` together.
  FrameTimes step(std::span<const Aabb> boxes);

  /// Compares the pairs with the oracle's.
  /// @param boxes Those of the last step, no NaN among them.
  [[nodiscard]] Difference verify(std::span<const Aabb> boxes);

 private:
  btBroadphaseInterface& broadphase_;
  std::vector<btBroadphaseProxy*> proxies_;
};

}  // namespace broadcl::scenes
