#pragma once

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <cstdint>
#include <span>

#include <broadcl/pair.hpp>

namespace broadcl {

// What the adapter asks of pair caches, its own and users'.

/// A cached pair by the ids of its proxies, of which neither is null.
[[nodiscard]] inline Pair pair_of(const btBroadphasePair& pair) {
  return {static_cast<std::uint32_t>(pair.m_pProxy0->m_uniqueId),
          static_cast<std::uint32_t>(pair.m_pProxy1->m_uniqueId)};
}

/// Whether a cache of this very class lets pairs in by their groups and masks, unless it has a callback. What
/// another class does cannot be known.
[[nodiscard]] bool filters_by_masks(const btOverlappingPairCache& cache);

/// Removes from a cache that removes nothing by itself what it holds but should not: what does not overlap,
/// and what it holds twice, of which the one with an algorithm stays.
/// @param removed What else is to go, in canonical order.
void remove_stale(btOverlappingPairCache& cache, std::span<const Pair> removed, btDispatcher* dispatcher);

}  // namespace broadcl
