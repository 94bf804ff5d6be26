#pragma once

#include <BulletCollision/BroadphaseCollision/btCollisionAlgorithm.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include <broadcl/pair.hpp>

#include "bullet/shape_culling.hpp"

namespace broadcl {

/// Bullet's hashed pair cache, except that the cost of removing or cleaning a proxy depends on the number of
/// its pairs, whereas Bullet's cache looks at all pairs. After any sequence of calls, it holds the same pairs
/// in the same order; it notifies ghosts and frees algorithms in the same order.
///
/// When a proxy is removed or cleaned, the partners of all proxies are listed. From then on, every pair that
/// is added is added to the lists. Pairs that are removed stay in the lists, so each entry is looked up in
/// the cache. After as many additions as there were pairs, the lists are discarded until they are needed
/// again; so they cost little if pairs come and go, but proxies do not. If there is no memory for them, the
/// cache does what Bullet's does.
///
/// When Bullet collides two objects or frees their contacts, it mostly waits for memory. So the cache
/// prefetches what the next pairs need. A pair may have an algorithm only if its clients are collision
/// objects or null.
class PairCache final : public btHashedOverlappingPairCache {
 public:
  PairCache() { manifolds_.reserve(1); }

  btBroadphasePair* addOverlappingPair(btBroadphaseProxy* proxy0, btBroadphaseProxy* proxy1) override;
  void removeOverlappingPairsContainingProxy(btBroadphaseProxy* proxy, btDispatcher* dispatcher) override;
  void cleanProxyFromPairs(btBroadphaseProxy* proxy, btDispatcher* dispatcher) override;

  using btHashedOverlappingPairCache::processAllOverlappingPairs;
  /// The overload that dispatchers call.
  void processAllOverlappingPairs(btOverlapCallback* callback, btDispatcher* dispatcher,
                                  const btDispatcherInfo& info) override;
  /// From now on, idle pairs are not dispatched, and lose their algorithms.
  /// @param culling Must outlive this object; null to dispatch all pairs.
  void set_culling(ShapeCulling* culling) noexcept { culling_ = culling; }

  /// The largest number of pairs for the following two functions.
  static constexpr std::size_t pairs_at_once = 32;
  /// To be called before these pairs are added.
  void prefetch_lookups(std::span<const Pair> pairs);
  /// To be called before these pairs are removed.
  void prefetch_removals(std::span<const Pair> pairs);

 private:
  /// Two ids whose pair is or was in the cache, and the next entry in the list of each.
  struct Entry {
    int a;
    int b;
    int next_of_a;
    int next_of_b;
  };

  /// The indices of a proxy's pairs in the array, ascending; none if it has no list or memory is exhausted.
  std::optional<std::vector<int>> indices_of(btBroadphaseProxy& proxy);
  /// The same from its list. Removes entries from the list whose pairs are gone.
  std::vector<int> listed_indices_of(btBroadphaseProxy& proxy);
  void bring_lists_up_to_date();
  void link(int id, int entry, int& next);

  /// Processes all pairs, in the order of the array.
  void process(btOverlapCallback& callback, btDispatcher* dispatcher, const btDispatcherInfo& info);
  /// Prefetches what the pairs after the k-th need when all are processed.
  void prefetch_after(int k);
  /// Prefetches what the narrow phase stores for a pair whose algorithm was already prefetched.
  void prefetch_contacts(btCollisionAlgorithm& algorithm);

  bool is_listed_ = false;
  std::vector<Entry> entries_;
  std::size_t most_ = 0;       // entries before the lists are given up
  std::size_t linked_ = 0;     // entries that are in lists; the rest came since they were last needed
  std::vector<int> newest_;    // by id: the first entry of its list, or none
  btManifoldArray manifolds_;  // of the current algorithm
  ShapeCulling* culling_ = nullptr;
};

}  // namespace broadcl
