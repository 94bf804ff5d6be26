#pragma once

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <cstdint>
#include <typeinfo>

#include <broadcl/filter.hpp>

#include "bullet/pair_cache.hpp"
#include "bullet/proxy_pool.hpp"

namespace broadcl {

/// Looks for groups and masks that users wrote in place, and for a new overlap filter callback.
class FilterWatch {
 public:
  FilterWatch(btOverlappingPairCache& cache, ProxyPool& pool) : cache_(cache), pool_(pool) {
    const std::type_info& type = typeid(cache);
    // What a user's class does cannot be known.
    filters_by_masks_ = type == typeid(PairCache) || type == typeid(btHashedOverlappingPairCache) ||
                        type == typeid(btSortedOverlappingPairCache) || type == typeid(btNullPairCache);
  }

  /// The filter as of the last look. If only the cache knows what may pair, it lets all proxies pair.
  [[nodiscard]] Filter filter(const Proxy& proxy) const {
    if (!filters_by_masks_ || callback_ != nullptr) return {};
    return {.group = static_cast<std::uint32_t>(proxy.seen_group),
            .mask = static_cast<std::uint32_t>(proxy.seen_mask)};
  }

  /// @param give Called with each proxy whose filter() may have changed since the last look.
  /// @returns Whether the callback has changed.
  template <class Function>
  bool look(const Function& give) {
    const bool is_new_callback = cache_.getOverlapFilterCallback() != callback_;
    callback_ = cache_.getOverlapFilterCallback();
    pool_.for_each_slot([&](Proxy& proxy) {
      const int group = proxy.m_collisionFilterGroup;
      const int mask = proxy.m_collisionFilterMask;
      const bool is_written = group != proxy.seen_group || mask != proxy.seen_mask;
      if (!is_written && !(is_new_callback && proxy.is_live())) return;
      proxy.seen_group = group;
      proxy.seen_mask = mask;
      pool_.mark_changed(proxy);
      give(proxy);
    });
    return is_new_callback;
  }

 private:
  btOverlappingPairCache& cache_;
  ProxyPool& pool_;
  bool filters_by_masks_;
  btOverlapFilterCallback* callback_ = cache_.getOverlapFilterCallback();
};

}  // namespace broadcl
