#pragma once

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <cstdint>
#include <typeinfo>

#include <broadcl/filter.hpp>

#include "bullet/pair_cache.hpp"
#include "bullet/proxy_pool.hpp"

namespace broadcl {

/// Detects groups and masks that users wrote in place, and a change of the overlap filter callback.
class FilterWatch {
 public:
  FilterWatch(btOverlappingPairCache& cache, ProxyPool& pool) : cache_(cache), pool_(pool) {
    const std::type_info& type = typeid(cache);
    // A user's class may filter in any way.
    filters_by_masks_ = type == typeid(PairCache) || type == typeid(btHashedOverlappingPairCache) ||
                        type == typeid(btSortedOverlappingPairCache) || type == typeid(btNullPairCache);
  }

  /// The filter of a proxy with these masks. If only the cache can decide what pairs, the filter lets
  /// everything pair.
  [[nodiscard]] Filter filter(const Masks& masks) const {
    if (!filters_by_masks_ || callback_ != nullptr) return {};
    return {.group = static_cast<std::uint32_t>(masks.group), .mask = static_cast<std::uint32_t>(masks.mask)};
  }

  /// @param give Called with each proxy whose filter may have changed since the last call.
  /// @returns Whether the callback has changed.
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
