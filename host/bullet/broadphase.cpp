#include <BulletCollision/BroadphaseCollision/btBroadphaseProxy.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <functional>
#include <iterator>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <broadcl/bullet.hpp>

#include "bullet/cached_pairs.hpp"
#include "bullet/pair_cache.hpp"
#include "bullet/proxy_pool.hpp"
#include "bullet/query_tree.hpp"
#include "pair_lists.hpp"

namespace broadcl {
namespace {

void print(const std::string& error) {
  std::fprintf(stderr, "%s\n", error.c_str());
}

/// The ids of proxies that a query finds.
struct Partners final : btBroadphaseAabbCallback {
  bool process(const btBroadphaseProxy* proxy) override {
    ids.push_back(static_cast<std::uint32_t>(proxy->m_uniqueId));
    return true;
  }
  std::vector<std::uint32_t> ids;
};

}  // namespace

class BulletBroadphase::Impl {
 public:
  Impl(const BroadPhase::Config& config, btOverlappingPairCache* cache)
      : core_(config),
        own_cache_(cache == nullptr ? new PairCache : nullptr),
        cache_(cache == nullptr ? own_cache_.get() : cache),
        filters_by_masks_(filters_by_masks(*cache_)),
        callback_(cache_->getOverlapFilterCallback()),
        cached_(cache_->getNumOverlappingPairs()) {}

  btBroadphaseProxy* create(const btVector3& lower, const btVector3& upper, void* client, int group,
                            int mask) {
    const std::uint32_t id =
        on_core([&] { return core_.add(box_of(lower, upper), core_filter(group, mask)); });
    Proxy& proxy = pool_.make(id);
    proxy.m_clientObject = client;
    proxy.m_collisionFilterGroup = proxy.seen_group = group;
    proxy.m_collisionFilterMask = proxy.seen_mask = mask;
    proxy.m_uniqueId = static_cast<int>(id);
    proxy.m_aabbMin = lower;
    proxy.m_aabbMax = upper;
    proxy.created = calculations_;
    mark_changed(proxy);
    queries_.touch(id);
    if (has_nan(lower, upper)) report_nan(proxy);
    if (pairs_at_once_) add_at_once(proxy);
    return &proxy;
  }

  void destroy(Proxy& proxy, btDispatcher* dispatcher) {
    const int before = cache_->getNumOverlappingPairs();
    cache_->removeOverlappingPairsContainingProxy(&proxy, dispatcher);
    cached_ += cache_->getNumOverlappingPairs() - before;
    std::erase_if(early_, [&](const Pair& pair) { return pair.a == proxy.id() || pair.b == proxy.id(); });
    core_.remove(proxy.id());
    queries_.touch(proxy.id());
    proxy = Proxy();
  }

  void move(Proxy& proxy, const btVector3& lower, const btVector3& upper) {
    const bool turns_bad = has_nan(lower, upper) && !has_nan(proxy.m_aabbMin, proxy.m_aabbMax);
    const bool is_moved = lower != proxy.m_aabbMin || upper != proxy.m_aabbMax;
    if (is_moved) {
      core_.move(proxy.id(), box_of(lower, upper));
      mark_changed(proxy);
      queries_.touch(proxy.id());
    }
    proxy.m_aabbMin = lower;
    proxy.m_aabbMax = upper;
    if (turns_bad) report_nan(proxy);
    if (is_moved && pairs_at_once_) add_at_once(proxy);
  }

  void begin() {
    send_filters();
    on_core([&] { core_.begin(); });
  }

  void calculate(btDispatcher* dispatcher) {
    send_filters();
    const bool cache_was_changed = cache_->getNumOverlappingPairs() != cached_;
    const Found found = find(is_filtered_anew_ || cache_was_changed);
    if (is_filtered_anew_ || cache_was_changed) {
      refused_ = difference(difference(found.all, found.added), cached_pairs());
    }
    const std::vector<Pair> early = take_early();
    refused_ = difference(refused_, early);

    std::vector<Pair> removals = difference(found.removed, refused_and_not_cached(found.removed));
    if (!found.removed.empty()) refused_ = difference(refused_, found.removed);
    if (is_filtered_anew_) removals = merge(removals, refuse_cached(found));
    // The pairs of a destroyed proxy went with it, though its id may be in use again.
    std::erase_if(removals, [&](const Pair& pair) { return !is_known(pair.a) || !is_known(pair.b); });
    removals = merge(removals, parted(difference(early, found.added)));
    remove(removals, cache_was_changed, dispatcher);
    add(merge(difference(found.added, early), take_refused_to_offer_again()));

    cached_ = cache_->getNumOverlappingPairs();
    is_filtered_anew_ = false;
    ++calculations_;
    queries_.start_frame();
  }

  void set_pairs_at_once(bool at_once) noexcept { pairs_at_once_ = at_once; }
  void set_error_handler(std::function<void(const std::string&)> handler) { on_error_ = std::move(handler); }

  [[nodiscard]] const ProxyPool& pool() const noexcept { return pool_; }
  [[nodiscard]] QueryTree& queries() noexcept { return queries_; }
  [[nodiscard]] btOverlappingPairCache* cache() const noexcept { return cache_; }
  [[nodiscard]] const BroadPhase& core() const noexcept { return core_; }

 private:
  void report_nan(const Proxy& proxy) const {
    on_error_(
        "proxy " + std::to_string(proxy.m_uniqueId) +
        " has a NaN bound and overlaps nothing until it gets a proper box; look for NaN in the transform, "
        "the velocities and the shape of its object");
  }

  /// What a calculation found.
  struct Found {
    std::span<const Pair> added;
    std::span<const Pair> removed;
    std::vector<Pair> all;  // where they were asked for
  };

  /// Does something with the core. Where its device fails, the host takes its place for good, and it is done
  /// there.
  template <class Function>
  std::invoke_result_t<Function> on_core(const Function& function) {
    try {
      return function();
    } catch (const std::exception& error) {
      if (core_.device() == nullptr) throw;
      go_on_without_device(error.what());
      return function();
    }
  }

  void go_on_without_device(const std::string& why) {
    core_ = BroadPhase({.algorithm = "sweep-and-prune"});
    is_new_core_ = true;
    std::size_t slots = 0;
    pool_.for_each([&](const Proxy& proxy) { slots = std::size_t{proxy.id()} + 1; });
    core_.map(slots);
    for (std::uint32_t id = 0; id < slots; ++id) {
      const Proxy& proxy = pool_[id];
      if (!proxy.is_live()) {
        core_.remove(id);
        continue;
      }
      core_.move(id, box_of(proxy));
      core_.set_filter(id, core_filter(proxy.seen_group, proxy.seen_mask));
    }
    on_error_(why + "; from now on pairs are found on the host, by sweep and prune");
  }

  Found find(bool all_too) {
    Found found = on_core([&] {
      const Delta delta = core_.finish();
      return Found{delta.added, delta.removed, all_too ? core_.pairs() : std::vector<Pair>()};
    });
    if (!is_new_core_) return found;
    is_new_core_ = false;
    std::vector<Pair> known = merge(cached_pairs(), refused_);
    std::erase_if(known, [&](const Pair& pair) { return !is_known(pair.a) || !is_known(pair.b); });
    refused_ = intersection(refused_, known);
    found.all.assign(found.added.begin(), found.added.end());
    added_ = difference(found.all, known);
    removed_ = difference(known, found.all);
    found.added = added_;
    found.removed = removed_;
    return found;
  }

  /// Adds what overlaps a proxy's box now and is not in the cache.
  void add_at_once(Proxy& proxy) {
    if (is_empty(box_of(proxy))) return;
    Partners partners;
    queries_.aabb_test(proxy.m_aabbMin, proxy.m_aabbMax, partners);
    std::sort(partners.ids.begin(), partners.ids.end());
    for (const std::uint32_t id : partners.ids) {
      if (id == proxy.id()) continue;
      const Pair pair{std::min(id, proxy.id()), std::max(id, proxy.id())};
      if (cache_->findPair(&pool_[pair.a], &pool_[pair.b]) != nullptr) continue;
      const int before = cache_->getNumOverlappingPairs();
      if (cache_->addOverlappingPair(&pool_[pair.a], &pool_[pair.b]) != nullptr) early_.push_back(pair);
      cached_ += cache_->getNumOverlappingPairs() - before;
    }
  }

  /// The pairs that were added at once since the last calculation.
  std::vector<Pair> take_early() {
    std::vector<Pair> early = std::exchange(early_, {});
    std::sort(early.begin(), early.end());
    early.erase(std::unique(early.begin(), early.end()), early.end());
    return early;
  }

  /// Those of the pairs that overlap no more, or that the cache would not let in any more.
  [[nodiscard]] std::vector<Pair> parted(std::vector<Pair> pairs) const {
    std::erase_if(pairs, [&](const Pair& pair) {
      Proxy& s = pool_[pair.a];
      Proxy& t = pool_[pair.b];
      return overlaps(box_of(s), box_of(t)) && cache_->needsBroadphaseCollision(&s, &t);
    });
    return pairs;
  }

  void mark_changed(Proxy& proxy) { proxy.changed = last_change_ = calculations_; }

  /// What the core is given: where only the cache knows what may pair, all do.
  [[nodiscard]] Filter core_filter(int group, int mask) const {
    if (!filters_by_masks_ || callback_ != nullptr) return {};
    return {.group = static_cast<std::uint32_t>(group), .mask = static_cast<std::uint32_t>(mask)};
  }

  /// Gives the core the filters that were written since the last time; all, where the callback is another
  /// one.
  void send_filters() {
    const bool is_new_callback = cache_->getOverlapFilterCallback() != callback_;
    callback_ = cache_->getOverlapFilterCallback();
    is_filtered_anew_ |= is_new_callback;
    pool_.for_each_slot([&](Proxy& proxy) {
      const int group = proxy.m_collisionFilterGroup;
      const int mask = proxy.m_collisionFilterMask;
      const bool is_written = group != proxy.seen_group || mask != proxy.seen_mask;
      if (!is_written && !(is_new_callback && proxy.is_live())) return;
      proxy.seen_group = group;
      proxy.seen_mask = mask;
      mark_changed(proxy);
      core_.set_filter(proxy.id(), core_filter(group, mask));
    });
  }

  /// The pairs in the cache, in canonical order.
  [[nodiscard]] std::vector<Pair> cached_pairs() const {
    std::vector<Pair> cached;
    const int n = cache_->getNumOverlappingPairs();
    cached.reserve(static_cast<std::size_t>(n));
    for (int k = 0; k < n; ++k) {
      const btBroadphasePair& pair = cache_->getOverlappingPairArrayPtr()[k];
      if (is_own(pair.m_pProxy0) && is_own(pair.m_pProxy1)) cached.push_back(pair_of(pair));
    }
    std::sort(cached.begin(), cached.end());
    return cached;
  }

  /// Of the pairs those that are not in the cache since it refused them. Somebody may have put one there.
  [[nodiscard]] std::vector<Pair> refused_and_not_cached(std::span<const Pair> pairs) const {
    std::vector<Pair> refused = intersection(pairs, refused_);
    std::erase_if(refused, [&](const Pair& pair) {
      return is_known(pair.a) && is_known(pair.b) &&
             cache_->findPair(&pool_[pair.a], &pool_[pair.b]) != nullptr;
    });
    return refused;
  }

  /// Of the pairs in the cache those that it would not let in now; they are refused from now on.
  std::vector<Pair> refuse_cached(const Found& found) {
    std::vector<Pair> cached = difference(difference(found.all, found.added), refused_);
    std::erase_if(cached, [&](const Pair& pair) {
      return cache_->needsBroadphaseCollision(&pool_[pair.a], &pool_[pair.b]);
    });
    refused_ = merge(refused_, cached);
    return cached;
  }

  /// The refused pairs of which an object has changed since the last calculation.
  std::vector<Pair> take_refused_to_offer_again() {
    if (refused_.empty() || last_change_ != calculations_) return {};
    const auto is_changed = [&](std::uint32_t id) { return pool_[id].changed == calculations_; };
    std::vector<Pair> offers;
    std::vector<Pair> kept;
    std::partition_copy(refused_.begin(), refused_.end(), std::back_inserter(offers),
                        std::back_inserter(kept),
                        [&](const Pair& pair) { return is_changed(pair.a) || is_changed(pair.b); });
    refused_ = std::move(kept);
    return offers;
  }

  void remove(std::span<const Pair> pairs, bool cache_was_changed, btDispatcher* dispatcher) {
    for (const Pair& pair : pairs) {
      cache_->removeOverlappingPair(&pool_[pair.a], &pool_[pair.b], dispatcher);
    }
    if (cache_->hasDeferredRemoval() && (!pairs.empty() || cache_was_changed)) {
      remove_stale(*cache_, pairs, dispatcher);
    }
  }

  void add(std::span<const Pair> pairs) {
    std::vector<Pair> refused;
    for (const Pair& pair : pairs) {
      if (cache_->addOverlappingPair(&pool_[pair.a], &pool_[pair.b]) == nullptr) refused.push_back(pair);
    }
    if (!refused.empty()) refused_ = merge(refused_, refused);
  }

  /// Users may put pairs of other proxies into their cache.
  [[nodiscard]] bool is_own(const btBroadphaseProxy* proxy) const {
    if (proxy == nullptr) return false;
    const auto id = static_cast<std::uint32_t>(proxy->m_uniqueId);
    return id < pool_.slots() && &pool_[id] == proxy;
  }

  /// Whether a proxy lives since before the last calculation.
  [[nodiscard]] bool is_known(std::uint32_t id) const {
    return pool_[id].is_live() && pool_[id].created != calculations_;
  }

  BroadPhase core_;
  std::unique_ptr<btOverlappingPairCache> own_cache_;
  btOverlappingPairCache* cache_;
  bool filters_by_masks_;
  btOverlapFilterCallback* callback_;  // as of the last look at it
  bool is_filtered_anew_ = false;      // the callback is another one than at the last calculation
  int cached_;                         // pairs in the cache, unless somebody else changes it
  ProxyPool pool_;
  QueryTree queries_{pool_};
  std::uint32_t calculations_ = 0;
  std::uint32_t last_change_ = 0;  // number of calculations before a proxy was last changed
  // Pairs that overlap, but the cache refused them or somebody removed them there.
  std::vector<Pair> refused_;
  bool pairs_at_once_ = false;
  std::vector<Pair> early_;            // added at once since the last calculation
  bool is_new_core_ = false;           // the core never calculated: it took over from a device
  std::vector<Pair> added_, removed_;  // in the calculation in which it did
  std::function<void(const std::string&)> on_error_ = print;
};

BulletBroadphase::BulletBroadphase(const BroadPhase::Config& config, btOverlappingPairCache* cache)
    : impl_(std::make_unique<Impl>(config, cache)) {}

BulletBroadphase::~BulletBroadphase() = default;

btBroadphaseProxy* BulletBroadphase::createProxy(const btVector3& aabbMin, const btVector3& aabbMax,
                                                 int /*shapeType*/, void* userPtr, int collisionFilterGroup,
                                                 int collisionFilterMask, btDispatcher* /*dispatcher*/) {
  return impl_->create(aabbMin, aabbMax, userPtr, collisionFilterGroup, collisionFilterMask);
}

void BulletBroadphase::destroyProxy(btBroadphaseProxy* proxy, btDispatcher* dispatcher) {
  impl_->destroy(static_cast<Proxy&>(*proxy), dispatcher);
}

void BulletBroadphase::setAabb(btBroadphaseProxy* proxy, const btVector3& aabbMin, const btVector3& aabbMax,
                               btDispatcher* /*dispatcher*/) {
  impl_->move(static_cast<Proxy&>(*proxy), aabbMin, aabbMax);
}

void BulletBroadphase::getAabb(btBroadphaseProxy* proxy, btVector3& aabbMin, btVector3& aabbMax) const {
  aabbMin = proxy->m_aabbMin;
  aabbMax = proxy->m_aabbMax;
}

void BulletBroadphase::rayTest(const btVector3& rayFrom, const btVector3& /*rayTo*/,
                               btBroadphaseRayCallback& rayCallback, const btVector3& aabbMin,
                               const btVector3& aabbMax) {
  impl_->queries().ray_test(rayFrom, rayCallback, aabbMin, aabbMax);
}

void BulletBroadphase::aabbTest(const btVector3& aabbMin, const btVector3& aabbMax,
                                btBroadphaseAabbCallback& callback) {
  impl_->queries().aabb_test(aabbMin, aabbMax, callback);
}

void BulletBroadphase::begin() {
  impl_->begin();
}

void BulletBroadphase::calculateOverlappingPairs(btDispatcher* dispatcher) {
  impl_->calculate(dispatcher);
}

btOverlappingPairCache* BulletBroadphase::getOverlappingPairCache() {
  return impl_->cache();
}

const btOverlappingPairCache* BulletBroadphase::getOverlappingPairCache() const {
  return impl_->cache();
}

void BulletBroadphase::getBroadphaseAabb(btVector3& aabbMin, btVector3& aabbMax) const {
  bool any = false;
  aabbMin = aabbMax = btVector3(0, 0, 0);
  impl_->pool().for_each([&](const Proxy& proxy) {
    if (is_empty(box_of(proxy))) return;
    if (!any) {
      aabbMin = proxy.m_aabbMin;
      aabbMax = proxy.m_aabbMax;
    }
    any = true;
    aabbMin.setMin(proxy.m_aabbMin);
    aabbMax.setMax(proxy.m_aabbMax);
  });
}

void BulletBroadphase::set_pairs_at_once(bool at_once) noexcept {
  impl_->set_pairs_at_once(at_once);
}

void BulletBroadphase::set_error_handler(std::function<void(const std::string&)> handler) {
  impl_->set_error_handler(std::move(handler));
}

const BroadPhase& BulletBroadphase::broad_phase() const noexcept {
  return impl_->core();
}

}  // namespace broadcl
