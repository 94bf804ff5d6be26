#include <broadcl/bullet.hpp>

#include <BulletCollision/BroadphaseCollision/btBroadphaseProxy.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/CollisionDispatch/btCollisionDispatcherMt.h>
#include <BulletCollision/CollisionDispatch/btCollisionWorld.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <tuple>
#include <utility>

#include <broadcl/broad_phase.hpp>

#include "bullet/cached_pairs.hpp"
#include "bullet/proxy_pool.hpp"
#include "bullet/proxy_queries.hpp"
#include "bullet/proxy_search.hpp"
#include "bullet/reports.hpp"
#include "bullet/shape_culling.hpp"

namespace broadcl {
namespace {

std::string text_of(const detail::BulletAbi& abi) {
  const std::string minor = std::to_string(abi.version % 100);
  const auto layout = [](const char* name, std::size_t size, std::size_t alignment) {
    return std::string(name) + " of " + std::to_string(size) + " bytes aligned to " +
           std::to_string(alignment);
  };
  return "Bullet " + std::to_string(abi.version / 100) + (minor.size() < 2 ? ".0" : ".") + minor + " (" +
         layout("btVector3", abi.vector_size, abi.vector_alignment) + ", " +
         layout("btBroadphaseProxy", abi.proxy_size, abi.proxy_alignment) + ", " +
         layout("btCollisionObject", abi.object_size, abi.object_alignment) + ")";
}

/// @returns The argument, so that it can be called before anything of Bullet is used.
const Config& refuse_other_bullet(const Config& config, const detail::BulletAbi& program) {
  const auto values = [](const detail::BulletAbi& abi) {
    return std::tie(abi.version, abi.vector_size, abi.vector_alignment, abi.proxy_size, abi.proxy_alignment,
                    abi.object_size, abi.object_alignment);
  };
  if (values(program) != values(detail::bullet_abi)) {
    throw Error("this program was compiled with " + text_of(program) + ", but BroadCL with " +
                text_of(detail::bullet_abi) +
                "; build BroadCL with the program's Bullet (docs/bullet.md), or look for another Bullet in "
                "the program's include path");
  }
  return config;
}

}  // namespace

struct BulletBroadphase::Impl {
  Impl(const Config& config, btOverlappingPairCache* users_cache)
      : pairs(users_cache, pool), search(config, pairs.cache(), pool, reports) {}

  void calculate(btDispatcher* dispatcher) {
    const ProxySearch::Found found = search.find(pairs.were_changed());
    if (found.all) {
      pairs.compare(*found.all, search.must_decide_again(), dispatcher);
    } else {
      pairs.apply(found.delta, dispatcher);
    }
    search.end_calculation();
    pool.end_calculation();
  }

  void add_at_once(Proxy& proxy) {
    if (are_pairs_added_at_once) search.attempt([&] { pairs.add_at_once(proxy, queries); });
  }

  void report_nan(const Proxy& proxy) {
    reports.tell({"proxy ", std::to_string(proxy.id()),
                  " has a NaN bound and overlaps nothing until it gets ",
                  "a valid box; look for NaN in the transform, the velocities and the shape of its object"});
  }

  void set_culling(const btCollisionWorld* world, const btBroadphaseInterface& self) {
    if (world == nullptr) {
      culling.set_world(nullptr);
      if (pairs.own() != nullptr) pairs.own()->set_culling(nullptr);
      return;
    }
    if (pairs.own() == nullptr) {
      throw Error::invalid_argument(
          "shape culling needs the broad phase's own pair cache; pass no cache to its constructor");
    }
    if (world->getBroadphase() != &self) {
      throw Error::invalid_argument(
          "the Bullet world for shape culling has another broad phase; pass the one that has this");
    }
    if (dynamic_cast<const btCollisionDispatcherMt*>(world->getDispatcher()) != nullptr) {
      throw Error::invalid_argument(
          "a btCollisionDispatcherMt dispatches the pairs itself, so shape culling would do nothing; "
          "use a btCollisionDispatcher");
    }
    culling.set_world(world);
    pairs.own()->set_culling(&culling);
  }

  Reports reports;
  ProxyPool pool;
  ShapeCulling culling{pool};
  CachedPairs pairs;
  ProxySearch search;
  ProxyQueries queries{pool, search};
  bool are_pairs_added_at_once = false;
};

BulletBroadphase::BulletBroadphase(const Config& config, btOverlappingPairCache* cache,
                                   const detail::BulletAbi& program)
    : impl_(std::make_unique<Impl>(refuse_other_bullet(config, program), cache)) {}

BulletBroadphase::~BulletBroadphase() = default;

btBroadphaseProxy* BulletBroadphase::createProxy(const btVector3& aabbMin, const btVector3& aabbMax,
                                                 int /*shapeType*/, void* userPtr, int collisionFilterGroup,
                                                 int collisionFilterMask, btDispatcher* /*dispatcher*/) {
  Proxy made;
  made.m_clientObject = userPtr;
  made.m_collisionFilterGroup = collisionFilterGroup;
  made.m_collisionFilterMask = collisionFilterMask;
  made.m_aabbMin = aabbMin;
  made.m_aabbMax = aabbMax;
  impl_->pool.reserve(impl_->search.core().size() + 1);  // the lowest free id is at most the number in use
  const std::uint32_t id = impl_->search.add(made);
  made.m_uniqueId = static_cast<int>(id);
  Proxy& proxy = impl_->pool[id] = made;
  impl_->pool.seen(id) = masks_of(made);
  impl_->pool.mark_created(proxy);
  impl_->culling.forget(id);
  if (has_nan(aabbMin, aabbMax)) impl_->report_nan(proxy);
  impl_->add_at_once(proxy);
  return &proxy;
}

void BulletBroadphase::destroyProxy(btBroadphaseProxy* proxy, btDispatcher* dispatcher) {
  auto& own = static_cast<Proxy&>(*proxy);
  const std::uint32_t id = own.id();
  impl_->search.remove(id);
  impl_->pairs.remove_pairs_of(own, dispatcher);
  impl_->pool.free(own);
}

void BulletBroadphase::setAabb(btBroadphaseProxy* proxy, const btVector3& aabbMin, const btVector3& aabbMax,
                               btDispatcher* /*dispatcher*/) {
  auto& own = static_cast<Proxy&>(*proxy);
  if (is_same(aabbMin, own.m_aabbMin) && is_same(aabbMax, own.m_aabbMax)) return;
  const bool is_good = is_proper(aabbMin, aabbMax);
  const bool turns_nan = !is_good && has_nan(aabbMin, aabbMax) && !has_nan(own.m_aabbMin, own.m_aabbMax);
  own.m_aabbMin = aabbMin;
  own.m_aabbMax = aabbMax;
  impl_->pool.mark_changed(own);
  impl_->search.move(own.id(), is_good ? proper_box(aabbMin, aabbMax) : empty_box());
  if (turns_nan) impl_->report_nan(own);
  impl_->add_at_once(own);
}

void BulletBroadphase::getAabb(btBroadphaseProxy* proxy, btVector3& aabbMin, btVector3& aabbMax) const {
  aabbMin = proxy->m_aabbMin;
  aabbMax = proxy->m_aabbMax;
}

void BulletBroadphase::rayTest(const btVector3& rayFrom, const btVector3& /*rayTo*/,
                               btBroadphaseRayCallback& rayCallback, const btVector3& aabbMin,
                               const btVector3& aabbMax) {
  impl_->queries.ray_test(rayFrom, rayCallback, aabbMin, aabbMax);
}

void BulletBroadphase::aabbTest(const btVector3& aabbMin, const btVector3& aabbMax,
                                btBroadphaseAabbCallback& callback) {
  impl_->queries.aabb_test(aabbMin, aabbMax, callback);
}

void BulletBroadphase::begin() {
  impl_->search.begin();
}

void BulletBroadphase::calculateOverlappingPairs(btDispatcher* dispatcher) {
  impl_->search.attempt([&] { impl_->calculate(dispatcher); });
}

btOverlappingPairCache* BulletBroadphase::getOverlappingPairCache() {
  return &impl_->pairs.cache();
}

const btOverlappingPairCache* BulletBroadphase::getOverlappingPairCache() const {
  return &impl_->pairs.cache();
}

void BulletBroadphase::getBroadphaseAabb(btVector3& aabbMin, btVector3& aabbMax) const {
  bool any = false;
  aabbMin = aabbMax = btVector3(0, 0, 0);
  impl_->pool.for_each([&](const Proxy& proxy) {
    if (!is_proper(proxy)) return;
    if (!std::exchange(any, true)) {
      aabbMin = proxy.m_aabbMin;
      aabbMax = proxy.m_aabbMax;
    }
    aabbMin.setMin(proxy.m_aabbMin);
    aabbMax.setMax(proxy.m_aabbMax);
  });
}

void BulletBroadphase::set_pairs_at_once(bool at_once) noexcept {
  impl_->are_pairs_added_at_once = at_once;
}

void BulletBroadphase::set_shape_culling(const btCollisionWorld* world) {
  impl_->set_culling(world, *this);
}

void BulletBroadphase::set_error_handler(std::function<void(const std::string&)> handler) {
  impl_->reports.set_handler(std::move(handler));
}

const BulletBroadphase::Core& BulletBroadphase::broad_phase() const noexcept {
  return impl_->search.core();
}

}  // namespace broadcl
