#include "bullet/pair_cache.hpp"

#include <BulletCollision/BroadphaseCollision/btDispatcher.h>
#include <BulletCollision/CollisionDispatch/btCollisionObject.h>
#include <BulletCollision/NarrowPhaseCollision/btPersistentManifold.h>

#include <algorithm>
#include <array>
#include <new>

#include "base/prefetch.hpp"

namespace broadcl {
namespace {

constexpr int none = -1;

/// What proxies and algorithms refer to is prefetched this many pairs ahead; proxies and algorithms
/// themselves, twice as many.
constexpr int ahead = 4;

/// The hash function of btHashedOverlappingPairCache (by Thomas Wang). If it differed, only the wrong memory
/// would be prefetched.
unsigned hash_of(const Pair& pair) {
  unsigned key = pair.a | pair.b << 16U;
  key += ~(key << 15U);
  key ^= key >> 10U;
  key += key << 3U;
  key ^= key >> 6U;
  key += ~(key << 11U);
  return key ^ key >> 16U;
}

/// An algorithm for two convex shapes, and the start of any other.
constexpr std::size_t algorithm_bytes = 128;

/// Up to this many pairs, looking at all of them takes less time than making lists.
constexpr int most_unlisted = 32;

/// Proxies that are not the adapter's may have any id; if there is no list for it, all pairs are looked at.
bool has_list(int id) {
  constexpr int end = 1 << 24;
  return 0 <= id && id < end;
}

/// @param client Of a pair that has an algorithm: a collision object, or null.
bool is_at_rest(const void* client) {
  return client != nullptr && !static_cast<const btCollisionObject*>(client)->isActive();
}

/// Passes on pairs that are not idle.
class CulledCallback final : public btOverlapCallback {
 public:
  CulledCallback(btOverlapCallback& callback, ShapeCulling& culling, btOverlappingPairCache& cache,
                 btDispatcher* dispatcher)
      : callback_(callback), culling_(culling), cache_(cache), dispatcher_(dispatcher) {}

  bool processOverlap(btBroadphasePair& pair) override {
    if (!culling_.is_idle(pair)) return callback_.processOverlap(pair);
    if (pair.m_algorithm != nullptr) cache_.cleanOverlappingPair(pair, dispatcher_);
    return false;
  }

 private:
  btOverlapCallback& callback_;
  ShapeCulling& culling_;
  btOverlappingPairCache& cache_;
  btDispatcher* dispatcher_;
};

}  // namespace

btBroadphasePair* PairCache::addOverlappingPair(btBroadphaseProxy* proxy0, btBroadphaseProxy* proxy1) {
  const int before = getNumOverlappingPairs();
  btBroadphasePair* pair = btHashedOverlappingPairCache::addOverlappingPair(proxy0, proxy1);
  if (!is_listed_ || getNumOverlappingPairs() == before) return pair;
  try {
    entries_.push_back({pair->m_pProxy0->getUid(), pair->m_pProxy1->getUid(), none, none});
    is_listed_ = entries_.size() < most_;
  } catch (const std::bad_alloc&) {
    is_listed_ = false;
  }
  return pair;
}

void PairCache::removeOverlappingPairsContainingProxy(btBroadphaseProxy* proxy, btDispatcher* dispatcher) {
  const std::optional<std::vector<int>> indices = indices_of(*proxy);
  if (!indices) {
    btHashedOverlappingPairCache::removeOverlappingPairsContainingProxy(proxy, dispatcher);
    return;
  }
  const btBroadphasePairArray& pairs = getOverlappingPairArray();
  std::size_t first = 0;
  std::size_t end = indices->size();
  while (first < end) {
    const btBroadphasePair pair = pairs[(*indices)[first]];
    // The last pair takes the index of the removed one; it may be the next one to be removed.
    const bool next_comes_here = end - first > 1 && (*indices)[end - 1] == pairs.size() - 1;
    removeOverlappingPair(pair.m_pProxy0, pair.m_pProxy1, dispatcher);
    if (next_comes_here) {
      --end;
    } else {
      ++first;
    }
  }
}

void PairCache::cleanProxyFromPairs(btBroadphaseProxy* proxy, btDispatcher* dispatcher) {
  const std::optional<std::vector<int>> indices = indices_of(*proxy);
  if (!indices) {
    btHashedOverlappingPairCache::cleanProxyFromPairs(proxy, dispatcher);
    return;
  }
  for (const int index : *indices) cleanOverlappingPair(getOverlappingPairArray()[index], dispatcher);
}

void PairCache::processAllOverlappingPairs(btOverlapCallback* callback, btDispatcher* dispatcher,
                                           const btDispatcherInfo& info) {
  // Otherwise objects may touch within the step.
  const bool is_discrete = info.m_dispatchFunc == btDispatcherInfo::DISPATCH_DISCRETE;
  if (culling_ != nullptr && is_discrete && culling_->begin_dispatch(dispatcher)) {
    CulledCallback culled(*callback, *culling_, *this, dispatcher);
    process(culled, dispatcher, info);
  } else {
    process(*callback, dispatcher, info);
  }
}

void PairCache::process(btOverlapCallback& callback, btDispatcher* dispatcher, const btDispatcherInfo& info) {
  if (info.m_deterministicOverlappingPairs) {
    btHashedOverlappingPairCache::processAllOverlappingPairs(&callback, dispatcher, info);
    return;
  }
  for (int k = 0; k < getNumOverlappingPairs();) {
    prefetch_after(k);
    btBroadphasePair& pair = getOverlappingPairArray()[k];
    if (callback.processOverlap(pair)) {
      removeOverlappingPair(pair.m_pProxy0, pair.m_pProxy1, dispatcher);
    } else {
      ++k;
    }
  }
}

void PairCache::prefetch_after(int k) {
  const btBroadphasePairArray& pairs = getOverlappingPairArray();
  if (k + 2 * ahead < pairs.size()) {
    const btBroadphasePair& pair = pairs[k + 2 * ahead];
    prefetch(pair.m_pProxy0);
    prefetch(pair.m_pProxy1);
    prefetch(pair.m_algorithm, algorithm_bytes);
  }
  if (culling_ != nullptr && k + 3 * ahead / 2 < pairs.size()) {
    culling_->prefetch_known(pairs[k + 3 * ahead / 2]);
  }
  if (k + ahead < pairs.size()) {
    const btBroadphasePair& pair = pairs[k + ahead];
    if (culling_ != nullptr) culling_->prefetch_objects(pair);
    // A pair without an algorithm is new, or needs none.
    if (pair.m_algorithm == nullptr) return;
    // Bullet skips pairs at rest. Prefetching for them would double the time of a frame without motion.
    if (is_at_rest(pair.m_pProxy0->m_clientObject) && is_at_rest(pair.m_pProxy1->m_clientObject)) return;
    prefetch(pair.m_pProxy0->m_clientObject, sizeof(btCollisionObject));
    prefetch(pair.m_pProxy1->m_clientObject, sizeof(btCollisionObject));
    prefetch_contacts(*pair.m_algorithm);
  }
}

void PairCache::prefetch_removals(std::span<const Pair> pairs) {
  prefetch_lookups(pairs);
  std::array<btCollisionAlgorithm*, pairs_at_once> algorithms{};
  std::size_t count = 0;
  btBroadphaseProxy a;  // found by their ids alone
  btBroadphaseProxy b;
  for (const Pair& pair : pairs) {
    a.m_uniqueId = static_cast<int>(pair.a);
    b.m_uniqueId = static_cast<int>(pair.b);
    const btBroadphasePair* found = findPair(&a, &b);
    if (found == nullptr || found->m_algorithm == nullptr) continue;
    algorithms[count++] = found->m_algorithm;
    prefetch(found->m_algorithm, algorithm_bytes);
  }
  for (btCollisionAlgorithm* algorithm : std::span(algorithms).first(count)) prefetch_contacts(*algorithm);
}

void PairCache::prefetch_lookups(std::span<const Pair> pairs) {
  if (m_hashTable.size() == 0) return;
  std::array<const int*, pairs_at_once> slots{};
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    slots[k] = &m_hashTable[static_cast<int>(hash_of(pairs[k]) % static_cast<unsigned>(m_hashTable.size()))];
    prefetch(slots[k]);
  }
  for (const int* slot : std::span(slots).first(pairs.size())) {
    if (*slot == BT_NULL_PAIR) continue;
    prefetch(&getOverlappingPairArray()[*slot]);
    prefetch(&m_next[*slot]);
  }
}

void PairCache::prefetch_contacts(btCollisionAlgorithm& algorithm) {
  manifolds_.resizeNoInitialize(0);
  algorithm.getAllContactManifolds(manifolds_);
  for (int k = 0; k < manifolds_.size(); ++k) prefetch(manifolds_[k], sizeof(btPersistentManifold));
}

std::optional<std::vector<int>> PairCache::indices_of(btBroadphaseProxy& proxy) {
  if (!has_list(proxy.getUid())) return std::nullopt;
  if (!is_listed_ && getNumOverlappingPairs() <= most_unlisted) return std::nullopt;
  try {
    bring_lists_up_to_date();
    return listed_indices_of(proxy);
  } catch (const std::bad_alloc&) {
    is_listed_ = false;  // a list may be half changed
    return std::nullopt;
  }
}

std::vector<int> PairCache::listed_indices_of(btBroadphaseProxy& proxy) {
  std::vector<int> indices;
  const int id = proxy.getUid();
  if (static_cast<std::size_t>(id) >= newest_.size()) return indices;
  btBroadphaseProxy partner;  // found by its id alone: one in the list may be dead
  int* next = &newest_[static_cast<std::size_t>(id)];
  for (int k = *next; k != none;) {
    Entry& entry = entries_[static_cast<std::size_t>(k)];
    const bool is_a = entry.a == id;
    int& after = is_a ? entry.next_of_a : entry.next_of_b;
    partner.m_uniqueId = is_a ? entry.b : entry.a;
    const btBroadphasePair* pair = findPair(&proxy, &partner);
    if (pair != nullptr) {
      *next = k;
      next = &after;
      // Proxies that are not the adapter's may share an id.
      if (pair->m_pProxy0 == &proxy || pair->m_pProxy1 == &proxy) {
        indices.push_back(static_cast<int>(pair - getOverlappingPairArrayPtr()));
      }
    }
    k = after;
  }
  *next = none;
  std::sort(indices.begin(), indices.end());
  indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
  return indices;
}

void PairCache::bring_lists_up_to_date() {
  if (!is_listed_) {
    const btBroadphasePairArray& pairs = getOverlappingPairArray();
    most_ = 2 * static_cast<std::size_t>(pairs.size()) + newest_.size();
    entries_.clear();
    newest_.clear();
    linked_ = 0;
    entries_.reserve(static_cast<std::size_t>(pairs.size()));
    for (int k = 0; k < pairs.size(); ++k) {
      entries_.push_back({pairs[k].m_pProxy0->getUid(), pairs[k].m_pProxy1->getUid(), none, none});
    }
    is_listed_ = true;
  }
  for (; linked_ < entries_.size(); ++linked_) {
    Entry& entry = entries_[linked_];
    link(entry.a, static_cast<int>(linked_), entry.next_of_a);
    link(entry.b, static_cast<int>(linked_), entry.next_of_b);
  }
}

void PairCache::link(int id, int entry, int& next) {
  if (!has_list(id)) return;
  const auto k = static_cast<std::size_t>(id);
  if (k >= newest_.size()) newest_.resize(k + 1, none);
  next = newest_[k];
  newest_[k] = entry;
}

}  // namespace broadcl
