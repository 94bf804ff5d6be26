#pragma once

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

namespace broadcl::scenes {

/// Empties a pair cache before proxies are destroyed: destroying a proxy searches all pairs for its own,
/// which is quick only if there are none.
inline void remove_all_pairs(btOverlappingPairCache& cache, btDispatcher* dispatcher) {
  struct RemoveAll final : btOverlapCallback {
    bool processOverlap(btBroadphasePair& /*pair*/) override { return true; }
  } remove_all;
  cache.processAllOverlappingPairs(&remove_all, dispatcher);
}

}  // namespace broadcl::scenes
