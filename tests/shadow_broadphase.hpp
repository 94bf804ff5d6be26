#pragma once

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <algorithm>
#include <cstddef>
#include <functional>
#include <unordered_map>
#include <utility>
#include <vector>

namespace broadcl::test {

/// Makes exactly the calls to any number of other broad phases that a world makes to a primary one. The world
/// sees only the primary's proxies, pairs and answers; each shadow has its own proxies and pair cache.
class ShadowBroadphase final : public btBroadphaseInterface {
 public:
  /// None is owned; all must outlive this object.
  ShadowBroadphase(btBroadphaseInterface& primary, std::vector<btBroadphaseInterface*> shadows)
      : primary_(primary), shadows_(std::move(shadows)) {}

  btBroadphaseProxy* createProxy(const btVector3& aabbMin, const btVector3& aabbMax, int shapeType,
                                 void* userPtr, int collisionFilterGroup, int collisionFilterMask,
                                 btDispatcher* dispatcher) override {
    const auto create = [&](btBroadphaseInterface& broadphase) {
      return broadphase.createProxy(aabbMin, aabbMax, shapeType, userPtr, collisionFilterGroup,
                                    collisionFilterMask, dispatcher);
    };
    btBroadphaseProxy* proxy = create(primary_);
    std::vector<btBroadphaseProxy*>& twins = twins_[proxy];
    for (btBroadphaseInterface* shadow : shadows_) twins.push_back(create(*shadow));
    return proxy;
  }

  void destroyProxy(btBroadphaseProxy* proxy, btDispatcher* dispatcher) override {
    for_each_twin(proxy, [&](auto& shadow, auto* twin) { shadow.destroyProxy(twin, dispatcher); });
    twins_.erase(proxy);
    primary_.destroyProxy(proxy, dispatcher);
  }

  void setAabb(btBroadphaseProxy* proxy, const btVector3& aabbMin, const btVector3& aabbMax,
               btDispatcher* dispatcher) override {
    primary_.setAabb(proxy, aabbMin, aabbMax, dispatcher);
    for_each_twin(proxy,
                  [&](auto& shadow, auto* twin) { shadow.setAabb(twin, aabbMin, aabbMax, dispatcher); });
  }

  void getAabb(btBroadphaseProxy* proxy, btVector3& aabbMin, btVector3& aabbMax) const override {
    primary_.getAabb(proxy, aabbMin, aabbMax);
  }

  void rayTest(const btVector3& rayFrom, const btVector3& rayTo, btBroadphaseRayCallback& rayCallback,
               const btVector3& aabbMin = btVector3(0, 0, 0),
               const btVector3& aabbMax = btVector3(0, 0, 0)) override {
    primary_.rayTest(rayFrom, rayTo, rayCallback, aabbMin, aabbMax);
  }

  void aabbTest(const btVector3& aabbMin, const btVector3& aabbMax,
                btBroadphaseAabbCallback& callback) override {
    primary_.aabbTest(aabbMin, aabbMax, callback);
  }

  void calculateOverlappingPairs(btDispatcher* dispatcher) override {
    primary_.calculateOverlappingPairs(dispatcher);
    for (btBroadphaseInterface* shadow : shadows_) shadow->calculateOverlappingPairs(dispatcher);
  }

  btOverlappingPairCache* getOverlappingPairCache() override { return primary_.getOverlappingPairCache(); }
  [[nodiscard]] const btOverlappingPairCache* getOverlappingPairCache() const override {
    return std::as_const(primary_).getOverlappingPairCache();
  }

  void getBroadphaseAabb(btVector3& aabbMin, btVector3& aabbMax) const override {
    primary_.getBroadphaseAabb(aabbMin, aabbMax);
  }

  void resetPool(btDispatcher* dispatcher) override {
    primary_.resetPool(dispatcher);
    for (btBroadphaseInterface* shadow : shadows_) shadow->resetPool(dispatcher);
  }

  void printStats() override {}

 private:
  template <class Function>
  void for_each_twin(btBroadphaseProxy* proxy, Function&& function) const {
    const std::vector<btBroadphaseProxy*>& twins = twins_.at(proxy);
    for (std::size_t k = 0; k < twins.size(); ++k) function(*shadows_[k], twins[k]);
  }

  btBroadphaseInterface& primary_;
  std::vector<btBroadphaseInterface*> shadows_;
  std::unordered_map<const btBroadphaseProxy*, std::vector<btBroadphaseProxy*>> twins_;
};

/// Two objects of a pair by their client pointers, in an order that all broad phases share.
using ClientPair = std::pair<const void*, const void*>;

/// The pair cache of a broad phase, sorted. A pair that is cached twice is listed twice.
[[nodiscard]] inline std::vector<ClientPair> client_pairs(btBroadphaseInterface& broadphase) {
  std::vector<ClientPair> pairs;
  const btBroadphasePairArray& cached = broadphase.getOverlappingPairCache()->getOverlappingPairArray();
  for (int k = 0; k < cached.size(); ++k) {
    const void* s = cached[k].m_pProxy0->m_clientObject;
    const void* t = cached[k].m_pProxy1->m_clientObject;
    pairs.push_back(std::less<>()(s, t) ? ClientPair(s, t) : ClientPair(t, s));
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

}  // namespace broadcl::test
