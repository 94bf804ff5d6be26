#pragma once

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include <broadcl/pair.hpp>

#include "base/pair_lists.hpp"
#include "bullet/pair_cache.hpp"
#include "bullet/proxy_pool.hpp"
#include "bullet/proxy_queries.hpp"

namespace broadcl {

/// Updates a pair cache, either the adapter's own or a user's. Others may change the cache, too.
class CachedPairs {
 public:
  /// @param cache If null, the object makes its own. The cache and the pool must outlive this object.
  CachedPairs(btOverlappingPairCache* cache, const ProxyPool& pool)
      : own_(cache == nullptr ? new PairCache : nullptr),
        cache_(cache == nullptr ? *own_ : *cache),
        pool_(pool) {}

  [[nodiscard]] btOverlappingPairCache& cache() const noexcept { return cache_; }

  /// The same cache if it is the adapter's own, otherwise null.
  [[nodiscard]] PairCache* own() const noexcept { return own_.get(); }

  /// Whether somebody else changed the number of pairs in the cache.
  [[nodiscard]] bool were_changed() const { return cache_.getNumOverlappingPairs() != count_; }

  void remove_pairs_of(Proxy& proxy, btDispatcher* dispatcher) {
    const int before = cache_.getNumOverlappingPairs();
    cache_.removeOverlappingPairsContainingProxy(&proxy, dispatcher);
    count_ += cache_.getNumOverlappingPairs() - before;
    std::erase_if(early_, [&](const Pair& pair) { return pair.a == proxy.id() || pair.b == proxy.id(); });
  }

  /// Adds the proxies that overlap a proxy's box now and whose pairs with it are not in the cache.
  void add_at_once(const Proxy& proxy, ProxyQueries& queries) {
    if (!is_proper(proxy)) return;
    Partners partners;
    queries.aabb_test(proxy.m_aabbMin, proxy.m_aabbMax, partners);
    std::sort(partners.ids.begin(), partners.ids.end());
    for (const std::uint32_t id : partners.ids) {
      if (id == proxy.id()) continue;
      const Pair pair{std::min(id, proxy.id()), std::max(id, proxy.id())};
      if (cache_.findPair(&pool_[pair.a], &pool_[pair.b]) != nullptr) continue;
      early_.push_back(pair);
      const int before = cache_.getNumOverlappingPairs();
      if (cache_.addOverlappingPair(&pool_[pair.a], &pool_[pair.b]) == nullptr) early_.pop_back();
      count_ += cache_.getNumOverlappingPairs() - before;
    }
  }

  /// Applies what changed since the last calculation.
  void apply(const Delta& delta, btDispatcher* dispatcher) {
    std::span<const Pair> removed = delta.removed;
    std::vector<Pair> to_remove;
    if (!refused_.empty() || !early_.empty() || !pool_.are_all_known()) {
      to_remove.assign(removed.begin(), removed.end());
      std::erase_if(to_remove, [&](const Pair& pair) { return !is_cached(pair); });
      to_remove = merge(to_remove, take_early_to_remove());
      refused_ = difference(refused_, removed);
      removed = to_remove;
    }
    update(delta.added, removed, dispatcher);
  }

  /// The same if anything may have changed.
  /// @param all All pairs that overlap.
  /// @param decide_again Whether to ask the cache again about each of its pairs whether it accepts it.
  void compare(std::span<const Pair> all, bool decide_again, btDispatcher* dispatcher) {
    early_.clear();
    const std::vector<Pair> cached = all_cached();
    std::vector<Pair> rejected = intersection(cached, all);
    std::erase_if(rejected, [&](const Pair& pair) { return !decide_again || is_let_in(pair); });
    refused_ = difference(all, cached);
    update({}, merge(difference(cached, all), rejected), dispatcher);
    refused_ = merge(refused_, rejected);
  }

 private:
  /// The ids of a pair's proxies, neither of which is null.
  static Pair pair_of(const btBroadphasePair& pair) {
    return {static_cast<std::uint32_t>(pair.m_pProxy0->m_uniqueId),
            static_cast<std::uint32_t>(pair.m_pProxy1->m_uniqueId)};
  }

  /// The ids of proxies that a query finds.
  struct Partners final : btBroadphaseAabbCallback {
    bool process(const btBroadphaseProxy* proxy) override {
      ids.push_back(static_cast<std::uint32_t>(proxy->m_uniqueId));
      return true;
    }
    std::vector<std::uint32_t> ids;
  };

  /// Removes pairs from the cache, adds others, and offers refused ones again if they changed.
  void update(std::span<const Pair> added, std::span<const Pair> removed, btDispatcher* dispatcher) {
    if (cache_.hasDeferredRemoval()) {
      if (!removed.empty() || were_changed()) remove_stale(removed, dispatcher);
    } else {
      remove(removed, dispatcher);
    }
    std::vector<Pair> offered;
    if (!refused_.empty() && pool_.is_any_changed()) {
      offered = merge(added, take_if(refused_, [&](const Pair& pair) { return pool_.is_changed(pair); }));
      added = offered;
    }
    const std::vector<Pair> refused = add(added);
    if (!refused.empty()) refused_ = merge(refused_, refused);
    early_.clear();
    count_ = cache_.getNumOverlappingPairs();
  }

  void remove(std::span<const Pair> pairs, btDispatcher* dispatcher) {
    for_each_part(pairs, [&](std::span<const Pair> part) {
      if (own_ != nullptr) own_->prefetch_removals(part);
      for (const Pair& pair : part) {
        cache_.removeOverlappingPair(&pool_[pair.a], &pool_[pair.b], dispatcher);
      }
    });
  }

  /// @returns Those that the cache refused.
  std::vector<Pair> add(std::span<const Pair> pairs) {
    std::vector<Pair> refused;
    for_each_part(pairs, [&](std::span<const Pair> part) {
      if (own_ != nullptr) own_->prefetch_lookups(part);
      for (const Pair& pair : part) {
        if (!early_.empty() && std::binary_search(early_.begin(), early_.end(), pair)) continue;
        if (cache_.addOverlappingPair(&pool_[pair.a], &pool_[pair.b]) == nullptr) refused.push_back(pair);
      }
    });
    return refused;
  }

  /// Calls a function with batches of pairs, as large as the adapter's own cache prefetches.
  template <class Function>
  static void for_each_part(std::span<const Pair> pairs, const Function& function) {
    for (std::size_t k = 0; k < pairs.size(); k += PairCache::pairs_at_once) {
      function(pairs.subspan(k, std::min(pairs.size() - k, PairCache::pairs_at_once)));
    }
  }

  /// The order of btBroadphasePairSortPredicate, which is none if proxies of several broad phases have the
  /// same ids: then these are also sorted by their addresses.
  struct InOrder {
    bool operator()(const btBroadphasePair& s, const btBroadphasePair& t) const {
      const auto precedes = [](const btBroadphaseProxy* p, const btBroadphaseProxy* q) {
        const auto id = [](const btBroadphaseProxy* proxy) {
          return proxy == nullptr ? -1 : proxy->m_uniqueId;
        };
        return id(p) != id(q) ? id(p) > id(q) : std::less<>()(p, q);
      };
      if (s.m_pProxy0 != t.m_pProxy0) return precedes(s.m_pProxy0, t.m_pProxy0);
      if (s.m_pProxy1 != t.m_pProxy1) return precedes(s.m_pProxy1, t.m_pProxy1);
      return std::greater<>()(s.m_algorithm, t.m_algorithm);
    }
  };

  /// For a cache with deferred removal: removes the pool's pairs that no longer overlap, and duplicates. Like
  /// Bullet's own broad phases, this sorts the cache, so that of two equal pairs the one with an algorithm
  /// stays.
  /// @param removed Other pairs to remove.
  void remove_stale(std::span<const Pair> removed, btDispatcher* dispatcher) {
    btBroadphasePairArray& pairs = cache_.getOverlappingPairArray();
    pairs.quickSort(InOrder());
    int staying = 0;
    for (int k = 0; k < pairs.size(); ++k) {
      btBroadphasePair& pair = pairs[k];
      const bool is_gone =
          is_own(pair) && (!overlaps(box_of(*pair.m_pProxy0), box_of(*pair.m_pProxy1)) ||
                           std::binary_search(removed.begin(), removed.end(), pair_of(pair)));
      const bool stays = pair.m_pProxy0 != nullptr && pair.m_pProxy1 != nullptr && !is_gone &&
                         (staying == 0 || !(pair == pairs[staying - 1]));
      if (stays) {
        pairs[staying++] = pair;
      } else {
        cache_.cleanOverlappingPair(pair, dispatcher);
      }
    }
    pairs.resize(staying);
  }

  /// Whether a pair that no longer overlaps is in the cache. The pairs of a destroyed proxy are gone, though
  /// its id may be in use again. A refused pair may have been added by somebody else.
  [[nodiscard]] bool is_cached(const Pair& pair) const {
    return pool_.is_known(pair) && (!std::binary_search(refused_.begin(), refused_.end(), pair) ||
                                    cache_.findPair(&pool_[pair.a], &pool_[pair.b]) != nullptr);
  }

  [[nodiscard]] bool is_let_in(const Pair& pair) const {
    return cache_.needsBroadphaseCollision(&pool_[pair.a], &pool_[pair.b]);
  }

  [[nodiscard]] bool is_own(const btBroadphaseProxy* proxy) const {
    const auto id = proxy == nullptr ? pool_.slots() : static_cast<std::uint32_t>(proxy->m_uniqueId);
    return id < pool_.slots() && &pool_[static_cast<std::uint32_t>(id)] == proxy;
  }

  /// Whether a pair is one of the pool's proxies. A user's cache may also have those of other broad phases.
  [[nodiscard]] bool is_own(const btBroadphasePair& pair) const {
    return is_own(pair.m_pProxy0) && is_own(pair.m_pProxy1);
  }

  /// The pairs of the pool's proxies in the cache, in canonical order.
  [[nodiscard]] std::vector<Pair> all_cached() const {
    std::vector<Pair> cached;
    const int n = cache_.getNumOverlappingPairs();
    cached.reserve(static_cast<std::size_t>(n));
    for (int k = 0; k < n; ++k) {
      const btBroadphasePair& pair = cache_.getOverlappingPairArrayPtr()[k];
      if (is_own(pair)) cached.push_back(pair_of(pair));
    }
    sort(cached);
    return cached;
  }

  /// Sorts the early pairs, and extracts those that no longer overlap or that the cache would refuse.
  std::vector<Pair> take_early_to_remove() {
    sort(early_);
    return take_if(early_, [&](const Pair& pair) {
      return !overlaps(box_of(pool_[pair.a]), box_of(pool_[pair.b])) || !is_let_in(pair);
    });
  }

  static void sort(std::vector<Pair>& pairs) {
    std::sort(pairs.begin(), pairs.end());
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  }

  /// Extracts those pairs from a list that meet a condition; both parts stay in order.
  template <class Condition>
  static std::vector<Pair> take_if(std::vector<Pair>& pairs, const Condition& condition) {
    const auto first = std::stable_partition(pairs.begin(), pairs.end(), std::not_fn(condition));
    std::vector<Pair> taken(first, pairs.end());
    pairs.erase(first, pairs.end());
    return taken;
  }

  std::unique_ptr<PairCache> own_;
  btOverlappingPairCache& cache_;
  const ProxyPool& pool_;
  int count_ = cache_.getNumOverlappingPairs();  // unless somebody else changes it
  // Pairs that overlap, but that the cache refused or that somebody removed from it. They are offered again
  // once one of their proxies has changed.
  std::vector<Pair> refused_;
  std::vector<Pair> early_;  // added at once since the last calculation, in any order
};

}  // namespace broadcl
