#pragma once

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <LinearMath/btAabbUtil2.h>

#include <algorithm>
#include <array>
#include <limits>

#include "base/moving_box.hpp"
#include "bullet/proxy_pool.hpp"
#include "bullet/proxy_search.hpp"
#include "engines/ranked_search.hpp"

namespace broadcl {

/// Answers ray and box queries with the tree of the core, if it has all boxes as they are now, or is worth
/// reading them; otherwise all proxies are tested.
///
/// Queries allocate nothing but for the tree. They may run in several threads at the same time, and within
/// one another, but not at the same time as other functions. Empty boxes are never found.
class ProxyQueries {
 public:
  /// @param pool, search Must outlive this object.
  ProxyQueries(const ProxyPool& pool, ProxySearch& search) : pool_(pool), search_(search) {}

  /// As btBroadphaseInterface::rayTest().
  void ray_test(const btVector3& from, btBroadphaseRayCallback& callback, const btVector3& lower,
                const btVector3& upper) {
    Moving moving{.box = proper_box(lower, upper), .length = std::max(callback.m_lambda_max, btScalar(0))};
    for (int axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<std::size_t>(axis);
      const btScalar reciprocal = callback.m_rayDirectionInverse[axis];
      moving.origin.at(k) = from[axis];
      // (0 would mean that it does not move. With NaN, nothing is excluded.)
      moving.reciprocals.at(k) = reciprocal == 0 ? std::numeric_limits<btScalar>::quiet_NaN() : reciprocal;
    }
    find(moving, [&](const Proxy& proxy) {
      const std::array bounds{proxy.m_aabbMin - upper, proxy.m_aabbMax - lower};
      btScalar hit = 1;
      if (is_proper(proxy) && btRayAabb2(from, callback.m_rayDirectionInverse, callback.m_signs,
                                         bounds.data(), hit, 0, callback.m_lambda_max)) {
        callback.process(&proxy);
      }
    });
  }

  /// As btBroadphaseInterface::aabbTest().
  void aabb_test(const btVector3& lower, const btVector3& upper, btBroadphaseAabbCallback& callback) {
    find(Moving{.box = proper_box(lower, upper)}, [&](const Proxy& proxy) {
      const bool is_found = overlaps(proxy.m_aabbMin, proxy.m_aabbMax, lower, upper);
      if (is_found && is_proper(proxy)) callback.process(&proxy);
    });
  }

 private:
  using Moving = MovingBox<ProxyBox>;

  template <class Function>
  class Search final : public RankedSearch<ProxyBox> {
   public:
    Search(const Moving& to_meet, const ProxyPool& pool, const Function& function)
        : pool_(pool), function_(function) {
      moving = &to_meet;
      most = to_meet.length;
    }
    void take(std::uint32_t slot, btScalar /*time*/) override { function_(pool_[slot]); }

   private:
    const ProxyPool& pool_;
    const Function& function_;
  };

  /// Calls a function at least with all proxies that a box meets.
  template <class Function>
  void find(const Moving& moving, const Function& function) {
    if (!search_.has_tree()) return pool_.for_each(function);
    Search<Function> search(moving, pool_, function);
    search_.find(search);
  }

  const ProxyPool& pool_;
  ProxySearch& search_;
};

}  // namespace broadcl
