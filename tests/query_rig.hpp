#pragma once

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <LinearMath/btAabbUtil2.h>

#include <array>
#include <cstddef>
#include <set>

#include "bullet_rig.hpp"
#include "ray_callback.hpp"

namespace broadcl::test {

/// The clients that a query reports, each as often as it is reported.
struct BoxCollector final : btBroadphaseAabbCallback {
  bool process(const btBroadphaseProxy* proxy) override {
    found.insert(proxy->m_clientObject);
    return false;  // this stops no query
  }
  std::multiset<const void*> found;
};

struct RayCollector : RayCallback {
  using RayCallback::RayCallback;
  bool process(const btBroadphaseProxy* proxy) override {
    found.insert(proxy->m_clientObject);
    return false;
  }
  /// By the statement of the contract.
  [[nodiscard]] bool must_report(const btBroadphaseProxy& proxy, const btVector3& from,
                                 const btVector3& lower, const btVector3& upper) const {
    const std::array bounds{proxy.m_aabbMin - upper, proxy.m_aabbMax - lower};
    btScalar hit = 1;
    return btRayAabb2(from, m_rayDirectionInverse, m_signs, bounds.data(), hit, 0, m_lambda_max);
  }
  std::multiset<const void*> found;
};

/// A rig with a grid of boxes that have clients.
class QueryRig : public Rig {
 public:
  explicit QueryRig(const Kind& kind) : Rig(kind) {
    Random random(8);
    for (std::size_t k = 0; k < clients.size(); ++k) {
      const btVector3 lower = random.point(20);
      const btVector3 upper = lower + random.point(3);
      move(create(lower, upper, static_cast<int>(k % 3), 0, &clients[k]), lower, upper);
    }
  }
  std::multiset<const void*> boxes(const btVector3& lower, const btVector3& upper) {
    BoxCollector collector;
    broadphase().aabbTest(lower, upper, collector);
    return collector.found;
  }
  std::multiset<const void*> rays(const btVector3& from, const btVector3& to) {
    RayCollector collector(from, to);
    broadphase().rayTest(from, to, collector);
    return collector.found;
  }

 private:
  inline static std::array<int, 400> clients{};  // the same for all, so that answers can be compared
};

}  // namespace broadcl::test
