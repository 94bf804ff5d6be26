#pragma once

#include <broadcl/aabb.hpp>
#include <broadcl/pair.hpp>
#include <cstddef>
#include <span>
#include <vector>

class btCollisionWorld;
class btOverlappingPairCache;
struct btBroadphaseProxy;

namespace broadcl::scenes {

/// How a pair cache differs from the oracle.
struct Difference {
  std::size_t missing = 0;  ///< Pairs that overlap and pass the filters, but are not in the cache.
  std::size_t extra = 0;    ///< Pairs in the cache that do not overlap or do not pass the filters.
};

/// @param pairs, expected Sorted.
[[nodiscard]] Difference difference(const std::vector<Pair>& pairs, const std::vector<Pair>& expected);

/// Compares a world's pair cache with what the algorithm `oracle` finds for the boxes that its proxies have
/// now, filtered by group and mask both ways. To be called after a step, when these are still the boxes that
/// the step's broad phase used.
[[nodiscard]] Difference verify(btCollisionWorld& world);

/// The same without a world.
/// @param proxies All proxies that may be in the cache.
/// @param boxes The boxes that they should have now, one per proxy, without NaNs.
[[nodiscard]] Difference verify(btOverlappingPairCache& cache, std::span<btBroadphaseProxy* const> proxies,
                                std::span<const Aabb> boxes);

}  // namespace broadcl::scenes
