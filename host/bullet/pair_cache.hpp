#pragma once

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <cstddef>
#include <optional>
#include <vector>

namespace broadcl {

/// Bullet's hashed pair cache, but removing or cleaning a proxy costs as much as the proxy has pairs, where
/// Bullet's own looks at every pair there is. It holds the same pairs in the same order, and tells ghosts and
/// frees algorithms in the same order, after any sequence of calls.
///
/// Partners of proxies are listed when a proxy is removed or cleaned. From then on the lists take every pair
/// that is added. They forget none that is removed: what they say is looked up in the cache. After as many
/// additions as there were pairs they are given up until they are needed again, so they cost little where
/// pairs come and go but no proxy does. If memory for them cannot be had, it does as Bullet's own does.
class PairCache final : public btHashedOverlappingPairCache {
 public:
  btBroadphasePair* addOverlappingPair(btBroadphaseProxy* proxy0, btBroadphaseProxy* proxy1) override;
  void removeOverlappingPairsContainingProxy(btBroadphaseProxy* proxy, btDispatcher* dispatcher) override;
  void cleanProxyFromPairs(btBroadphaseProxy* proxy, btDispatcher* dispatcher) override;

 private:
  /// Two ids whose pair was in the cache at some time, and the next entry in the list of each.
  struct Entry {
    int a;
    int b;
    int next_of_a;
    int next_of_b;
  };

  /// Where the pairs of a proxy are in the array, ascending; none if it has no list or memory is exhausted.
  std::optional<std::vector<int>> places_of(btBroadphaseProxy& proxy);
  /// The same from its list, which forgets what is gone.
  std::vector<int> listed_places_of(btBroadphaseProxy& proxy);
  void bring_lists_up_to_date();
  void link(int id, int entry, int& next);

  bool is_listed_ = false;
  std::vector<Entry> entries_;
  std::size_t most_ = 0;     // entries before the lists are given up
  std::size_t linked_ = 0;   // entries that are in lists; the rest came since they were last needed
  std::vector<int> newest_;  // by id: the first entry of its list, or none
};

}  // namespace broadcl
