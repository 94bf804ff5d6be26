#pragma once

#include <broadcl/aabb.hpp>
#include <cstddef>
#include <span>

class btCollisionWorld;
class btOverlappingPairCache;
struct btBroadphaseProxy;

namespace broadcl::scenes {

/// How a pair cache differs from the oracle.
struct Difference {
  std::size_t missing = 0;  ///< Pairs that overlap and pass the filters, but are not in the cache.
  std::size_t extra = 0;    ///< Pairs in the cache that do not overlap or do not pass the filters.
};

/// Compares a world's pair cache with the `oracle` algorithm over the boxes that its proxies have now,
/// filtered by group and mask both ways. Call it after a step: the boxes are those that the step's broad
/// phase saw.
[[nodiscard]] Difference verify(btCollisionWorld& world);

/// The same where there is no world.
/// @param proxies All that the cache may know.
/// @param boxes What they should have now, a box a proxy, no NaN among them.
[[nodiscard]] Difference verify(btOverlappingPairCache& cache, std::span<btBroadphaseProxy* const> proxies,
                                std::span<const Aabb> boxes);

}  // namespace broadcl::scenes
