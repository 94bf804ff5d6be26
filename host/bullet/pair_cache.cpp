#include "bullet/pair_cache.hpp"

#include <algorithm>
#include <new>

namespace broadcl {
namespace {

constexpr int none = -1;

/// Proxies that are not the adapter's may have any id; for those without a list every pair is looked at.
bool has_list(int id) {
  constexpr int end = 1 << 24;
  return 0 <= id && id < end;
}

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
    // The last pair of the array moves to the index of the removed one; it may be the next to be removed.
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

std::optional<std::vector<int>> PairCache::indices_of(btBroadphaseProxy& proxy) {
  if (!has_list(proxy.getUid())) return std::nullopt;
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
  btBroadphaseProxy partner;  // found by its id alone: one in the list may no longer exist
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
