#include <BulletCollision/BroadphaseCollision/btBroadphaseProxy.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <LinearMath/btAabbUtil2.h>

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include <broadcl/bullet.hpp>

namespace broadcl {
namespace {

struct Proxy : btBroadphaseProxy {
  using btBroadphaseProxy::btBroadphaseProxy;
  bool known = false;  // to the last calculation
};

/// As the core takes it: a box with a NaN bound overlaps nothing, so it becomes an empty one.
Aabb to_core(const btVector3& lower, const btVector3& upper) {
  const Aabb box = {{lower.x(), lower.y(), lower.z()}, {upper.x(), upper.y(), upper.z()}};
  constexpr float infinity = std::numeric_limits<float>::infinity();
  return has_nan(box) ? Aabb{{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}} : box;
}

bool is_empty(const btBroadphaseProxy& proxy) {
  return broadcl::is_empty(to_core(proxy.m_aabbMin, proxy.m_aabbMax));
}

}  // namespace

class BulletBroadphase::Impl {
 public:
  Impl(const BroadPhase::Config& config, btOverlappingPairCache* cache)
      : core_(config),
        own_cache_(cache == nullptr ? new btHashedOverlappingPairCache : nullptr),
        cache_(cache == nullptr ? own_cache_.get() : cache) {}

  btBroadphaseProxy* create(const btVector3& lower, const btVector3& upper, void* client, int group,
                            int mask) {
    auto proxy = std::make_unique<Proxy>(lower, upper, client, group, mask);
    const std::uint32_t id = core_.add(to_core(lower, upper));
    proxy->m_uniqueId = static_cast<int>(id);
    if (id >= proxies_.size()) proxies_.resize(id + 1);
    proxies_[id] = std::move(proxy);
    return proxies_[id].get();
  }

  void destroy(btBroadphaseProxy* proxy, btDispatcher* dispatcher) {
    cache_->removeOverlappingPairsContainingProxy(proxy, dispatcher);
    core_.remove(id_of(*proxy));
    proxies_[id_of(*proxy)].reset();
  }

  void move(btBroadphaseProxy& proxy, const btVector3& lower, const btVector3& upper) {
    core_.move(id_of(proxy), to_core(lower, upper));
    proxy.m_aabbMin = lower;
    proxy.m_aabbMax = upper;
  }

  void calculate(btDispatcher* dispatcher) {
    const Delta delta = core_.update();
    for (const Pair& pair : delta.removed) {
      // The pairs of a destroyed proxy went with it, though its id may be in use again.
      if (is_known(pair.a) && is_known(pair.b)) {
        cache_->removeOverlappingPair(proxies_[pair.a].get(), proxies_[pair.b].get(), dispatcher);
      }
    }
    for (const Pair& pair : delta.added) {
      cache_->addOverlappingPair(proxies_[pair.a].get(), proxies_[pair.b].get());
    }
    for_each_proxy([](Proxy& proxy) { proxy.known = true; });
  }

  template <class Function>
  void for_each_proxy(Function&& function) const {
    for (const auto& proxy : proxies_) {
      if (proxy != nullptr) function(*proxy);
    }
  }

  [[nodiscard]] btOverlappingPairCache* cache() const noexcept { return cache_; }
  [[nodiscard]] const BroadPhase& core() const noexcept { return core_; }

 private:
  static std::uint32_t id_of(const btBroadphaseProxy& proxy) {
    return static_cast<std::uint32_t>(proxy.m_uniqueId);
  }

  [[nodiscard]] bool is_known(std::uint32_t id) const {
    return proxies_[id] != nullptr && proxies_[id]->known;
  }

  BroadPhase core_;
  std::unique_ptr<btOverlappingPairCache> own_cache_;
  btOverlappingPairCache* cache_;
  std::vector<std::unique_ptr<Proxy>> proxies_;  // by id
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
  impl_->destroy(proxy, dispatcher);
}

void BulletBroadphase::setAabb(btBroadphaseProxy* proxy, const btVector3& aabbMin, const btVector3& aabbMax,
                               btDispatcher* /*dispatcher*/) {
  impl_->move(*proxy, aabbMin, aabbMax);
}

void BulletBroadphase::getAabb(btBroadphaseProxy* proxy, btVector3& aabbMin, btVector3& aabbMax) const {
  aabbMin = proxy->m_aabbMin;
  aabbMax = proxy->m_aabbMax;
}

void BulletBroadphase::rayTest(const btVector3& rayFrom, const btVector3& /*rayTo*/,
                               btBroadphaseRayCallback& rayCallback, const btVector3& aabbMin,
                               const btVector3& aabbMax) {
  impl_->for_each_proxy([&](const Proxy& proxy) {
    const std::array bounds{proxy.m_aabbMin - aabbMax, proxy.m_aabbMax - aabbMin};
    btScalar hit = 1;
    if (!is_empty(proxy) && btRayAabb2(rayFrom, rayCallback.m_rayDirectionInverse, rayCallback.m_signs,
                                       bounds.data(), hit, 0, rayCallback.m_lambda_max)) {
      rayCallback.process(&proxy);
    }
  });
}

void BulletBroadphase::aabbTest(const btVector3& aabbMin, const btVector3& aabbMax,
                                btBroadphaseAabbCallback& callback) {
  const Aabb query = to_core(aabbMin, aabbMax);
  impl_->for_each_proxy([&](const Proxy& proxy) {
    if (overlaps(to_core(proxy.m_aabbMin, proxy.m_aabbMax), query)) callback.process(&proxy);
  });
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
  impl_->for_each_proxy([&](const Proxy& proxy) {
    if (is_empty(proxy)) return;
    if (!any) {
      aabbMin = proxy.m_aabbMin;
      aabbMax = proxy.m_aabbMax;
    }
    any = true;
    aabbMin.setMin(proxy.m_aabbMin);
    aabbMax.setMax(proxy.m_aabbMax);
  });
}

const BroadPhase& BulletBroadphase::broad_phase() const noexcept {
  return impl_->core();
}

}  // namespace broadcl
