#include "bullet/cached_pairs.hpp"

#include <algorithm>
#include <set>
#include <typeinfo>

#include "bullet/pair_cache.hpp"
#include "bullet/proxy.hpp"

namespace broadcl {
namespace {

/// Says of each cached pair whether it is to go. Of two that are the same, the one with an algorithm may have
/// been swapped to any place by the removal of others.
class RemoveStale final : public btOverlapCallback {
 public:
  /// @param removed What ceased to overlap, in canonical order.
  RemoveStale(std::span<const Pair> removed, const btOverlappingPairCache& cache) : removed_(removed) {
    const int n = cache.getNumOverlappingPairs();
    for (int k = 0; k < n; ++k) {
      const btBroadphasePair& pair = cache.getOverlappingPairArrayPtr()[k];
      if (is_whole(pair) && pair.m_algorithm != nullptr) have_algorithms_.insert(pair_of(pair));
    }
  }

  bool processOverlap(btBroadphasePair& pair) override {
    if (!is_whole(pair)) return true;
    const Pair ids = pair_of(pair);
    return std::binary_search(removed_.begin(), removed_.end(), ids) ||
           !overlaps(box_of(*pair.m_pProxy0), box_of(*pair.m_pProxy1)) ||
           (pair.m_algorithm == nullptr && have_algorithms_.contains(ids)) || !seen_.insert(ids).second;
  }

 private:
  static bool is_whole(const btBroadphasePair& pair) {
    return pair.m_pProxy0 != nullptr && pair.m_pProxy1 != nullptr;
  }

  std::span<const Pair> removed_;
  std::set<Pair> have_algorithms_;
  std::set<Pair> seen_;
};

}  // namespace

bool filters_by_masks(const btOverlappingPairCache& cache) {
  const std::type_info& type = typeid(cache);
  return type == typeid(PairCache) || type == typeid(btHashedOverlappingPairCache) ||
         type == typeid(btSortedOverlappingPairCache) || type == typeid(btNullPairCache);
}

void remove_stale(btOverlappingPairCache& cache, std::span<const Pair> removed, btDispatcher* dispatcher) {
  RemoveStale stale(removed, cache);
  cache.processAllOverlappingPairs(&stale, dispatcher);
}

}  // namespace broadcl
