#pragma once

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <cstdint>
#include <typeinfo>

#include <broadcl/filter.hpp>

#include "bullet/pair_cache.hpp"
#include "bullet/proxy_pool.hpp"

namespace broadcl {

/// Looks for groups and masks that users wrote in place, and for another overlap filter callback.
class FilterWatch {
 public:
  FilterWatch(btOverlappingPairCache& cache, ProxyPool& pool) : cache_(cache), pool_(pool) {
    const std::type_info& type = typeid(cache);
    // What a user's class does cannot be known.
    filters_by_masks_ = type == typeid(PairCache) || type == typeid(btHashedOverlappingPairCache) ||
                        type == typeid(btSortedOverlappingPairCache) || type == typeid(btNullPairCache);
  }

  /// Of a proxy with these masks. If only the cache knows what may pair, all proxies may.
  [[nodiscard]] Filter filter(const Masks& masks) const {
    if (!filters_by_masks_ || callback_ != nullptr) return {};
    return {.group = static_cast<std::uint32_t>(masks.group), .mask = static_cast<std::uint32_t>(masks.mask)};
  }

  /// @param give Called with each proxy whose filter may be another one since the last look.
  /// @returns Whether the callback is another one.
  template <class Function>
  bool look(const Function& give) {
    const auto take = [&](Proxy& proxy) {
      pool_.mark_changed(proxy);
      give(proxy);
    };
    pool_.for_each_written(take);
    if (cache_.getOverlapFilterCallback() == callback_) return false;
    callback_ = cache_.getOverlapFilterCallback();
    pool_.for_each(take);
    return true;
  }

 private:
  btOverlappingPairCache& cache_;
  ProxyPool& pool_;
  bool filters_by_masks_;
  btOverlapFilterCallback* callback_ = cache_.getOverlapFilterCallback();
};

}  // namespace broadcl
