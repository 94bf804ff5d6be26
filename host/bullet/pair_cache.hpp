#pragma once

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <cstddef>
#include <optional>
#include <vector>

namespace broadcl {

/// Bullet's hashed pair cache, except that removing or cleaning a proxy takes time in proportion to the
/// proxy's pairs, while Bullet's own looks at every pair. It holds the same pairs in the same order, and
/// notifies ghosts and frees algorithms in the same order, after any sequence of calls.
///
/// Partners of proxies are listed when a proxy is removed or cleaned. From then on every pair that is added
/// is listed too. Pairs that are removed stay listed: what the lists say is looked up in the cache. After as
/// many additions as there were pairs the lists are dropped until they are needed again, so they cost little
/// if pairs come and go but no proxy does. If there is no memory for them, this cache does what Bullet's own
/// does.
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

  /// The indices of a proxy's pairs in the array, ascending; none if it has no list or memory is exhausted.
  std::optional<std::vector<int>> indices_of(btBroadphaseProxy& proxy);
  /// The same from its list, from which this drops removed pairs.
  std::vector<int> listed_indices_of(btBroadphaseProxy& proxy);
  void bring_lists_up_to_date();
  void link(int id, int entry, int& next);

  bool is_listed_ = false;
  std::vector<Entry> entries_;
  std::size_t most_ = 0;     // entries before the lists are dropped
  std::size_t linked_ = 0;   // entries that are in lists; the rest were added since they were last needed
  std::vector<int> newest_;  // by id: the first entry of its list, or none
};

}  // namespace broadcl
