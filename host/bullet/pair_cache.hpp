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

/// Bullet's hashed pair cache, but removing or cleaning a proxy costs as much as the proxy has pairs;
/// Bullet's own looks at every pair there is. It holds the same pairs in the same order, and notifies ghosts
/// and frees algorithms in the same order, after any sequence of calls.
///
/// Partners of proxies are listed when a proxy is removed or cleaned. From then on the lists take every pair
/// that is added. They forget none that is removed: what they say is looked up in the cache. After as many
/// additions as there were pairs they are given up until they are needed again, so they cost little if pairs
/// come and go but no proxy does. If memory for them cannot be had, it does as Bullet's own does.
///
/// What Bullet does with a pair, when it collides two objects or frees their contacts, is mostly waiting for
/// memory. So the cache prefetches what the next pairs need.
class PairCache final : public btHashedOverlappingPairCache {
 public:
  PairCache() { manifolds_.reserve(1); }

  btBroadphasePair* addOverlappingPair(btBroadphaseProxy* proxy0, btBroadphaseProxy* proxy1) override;
  void removeOverlappingPairsContainingProxy(btBroadphaseProxy* proxy, btDispatcher* dispatcher) override;
  void cleanProxyFromPairs(btBroadphaseProxy* proxy, btDispatcher* dispatcher) override;

  using btHashedOverlappingPairCache::processAllOverlappingPairs;
  /// The one that dispatchers call.
  void processAllOverlappingPairs(btOverlapCallback* callback, btDispatcher* dispatcher,
                                  const btDispatcherInfo& info) override;
  /// Pairs that are idle are not dispatched any more, and lose their algorithms.
  /// @param culling Must outlive this object; null to dispatch all pairs.
  void set_culling(ShapeCulling* culling) noexcept { culling_ = culling; }

  /// As many pairs as the following two take, by the ids of their proxies.
  static constexpr std::size_t pairs_at_once = 32;
  /// To be called before these pairs are added.
  void prefetch_lookups(std::span<const Pair> pairs);
  /// To be called before these pairs are removed.
  void prefetch_removals(std::span<const Pair> pairs);

 private:
  /// Two ids whose pair was in the cache at some time, and the next entry in the list of each.
  struct Entry {
    int a;
    int b;
    int next_of_a;
    int next_of_b;
  };

  /// Of the pairs of a proxy in the array, ascending; none if it has no list or memory is exhausted.
  std::optional<std::vector<int>> indices_of(btBroadphaseProxy& proxy);
  /// The same from its list, which forgets what is gone.
  std::vector<int> listed_indices_of(btBroadphaseProxy& proxy);
  void bring_lists_up_to_date();
  void link(int id, int entry, int& next);

  /// All pairs, if they are not asked for in another order.
  void process(btOverlapCallback& callback, btDispatcher* dispatcher, const btDispatcherInfo& info);
  /// For the pairs that follow the k-th when all are processed.
  void prefetch_after(int k);
  /// All that the narrow phase remembers of a pair, whose algorithm was prefetched itself.
  void prefetch_contacts(btCollisionAlgorithm& algorithm);

  bool is_listed_ = false;
  std::vector<Entry> entries_;
  std::size_t most_ = 0;       // entries before the lists are given up
  std::size_t linked_ = 0;     // entries that are in lists; the rest came since they were last needed
  std::vector<int> newest_;    // by id: the first entry of its list, or none
  btManifoldArray manifolds_;  // of the algorithm at hand
  ShapeCulling* culling_ = nullptr;
};

}  // namespace broadcl
