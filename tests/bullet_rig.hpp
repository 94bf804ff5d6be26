#pragma once

#include <BulletCollision/BroadphaseCollision/btAxisSweep3.h>
#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <BulletCollision/BroadphaseCollision/btSimpleBroadphase.h>
#include <BulletCollision/CollisionDispatch/btCollisionDispatcher.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>
#include <LinearMath/btAabbUtil2.h>

#include <array>
#include <cstddef>
#include <memory>
#include <ostream>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/bullet.hpp>

namespace broadcl::test {

constexpr int all_bits = -1;

/// A broad phase by name.
struct Kind {
  std::string name;
  std::unique_ptr<btBroadphaseInterface> (*make)(btOverlappingPairCache* cache);
};

inline std::ostream& operator<<(std::ostream& out, const Kind& kind) {
  return out << kind.name;
}

constexpr std::size_t capacity = 4096;

inline const std::array kinds{
    Kind{"BroadCL",
         [](btOverlappingPairCache* cache) -> std::unique_ptr<btBroadphaseInterface> {
           return std::make_unique<BulletBroadphase>(Config(), cache);
         }},
    Kind{"Tree",
         [](btOverlappingPairCache* cache) -> std::unique_ptr<btBroadphaseInterface> {
           return std::make_unique<btDbvtBroadphase>(cache);
         }},
    Kind{"Sweep",
         [](btOverlappingPairCache* cache) -> std::unique_ptr<btBroadphaseInterface> {
           const btVector3 edge(1000, 1000, 1000);
           return std::make_unique<bt32BitAxisSweep3>(-edge, edge, capacity, cache);
         }},
    Kind{"Simple",
         [](btOverlappingPairCache* cache) -> std::unique_ptr<btBroadphaseInterface> {
           return std::make_unique<btSimpleBroadphase>(capacity, cache);
         }},
    Kind{"BroadCLAtOnce", [](btOverlappingPairCache* cache) -> std::unique_ptr<btBroadphaseInterface> {
           auto broadphase = std::make_unique<BulletBroadphase>(Config(), cache);
           broadphase->set_pairs_at_once(true);
           return broadphase;
         }}};

class Random {
 public:
  explicit Random(unsigned number) : engine_(number) {}
  unsigned below(unsigned n) { return static_cast<unsigned>(engine_()) % n; }
  /// In tenths, so that boxes touch.
  btScalar coordinate(unsigned range) { return static_cast<btScalar>(below(10 * range)) / 10; }
  btVector3 point(unsigned range) {
    const btScalar x = coordinate(range);
    const btScalar y = coordinate(range);
    return {x, y, coordinate(range)};
  }

 private:
  std::mt19937 engine_;
};

/// Null if the cache does not have the pair, in either order.
inline btBroadphasePair* find(btOverlappingPairCache& cache, const btBroadphaseProxy* s,
                              const btBroadphaseProxy* t) {
  btBroadphasePairArray& pairs = cache.getOverlappingPairArray();
  for (int k = 0; k < pairs.size(); ++k) {
    const bool same = pairs[k].m_pProxy0 == s && pairs[k].m_pProxy1 == t;
    if (same || (pairs[k].m_pProxy0 == t && pairs[k].m_pProxy1 == s)) return &pairs[k];
  }
  return nullptr;
}

/// Pairs of boxes that overlap, as Bullet tests them, but are not in the cache.
inline int missing(btOverlappingPairCache& cache, std::span<const btBroadphaseProxy* const> proxies) {
  int count = 0;
  for (std::size_t b = 0; b < proxies.size(); ++b) {
    for (std::size_t a = 0; a < b; ++a) {
      const btBroadphaseProxy& s = *proxies[a];
      const btBroadphaseProxy& t = *proxies[b];
      const bool overlap = TestAabbAgainstAabb2(s.m_aabbMin, s.m_aabbMax, t.m_aabbMin, t.m_aabbMax);
      if (overlap && find(cache, &s, &t) == nullptr) ++count;
    }
  }
  return count;
}

/// Proxies on a broad phase; the destructor destroys those that still exist.
class Rig {
 public:
  explicit Rig(const Kind& kind, btOverlappingPairCache* cache = nullptr) : broadphase_(kind.make(cache)) {}
  ~Rig() {
    for (btBroadphaseProxy* proxy : proxies_) broadphase_->destroyProxy(proxy, &dispatcher_);
  }
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;
  Rig(Rig&&) = delete;
  Rig& operator=(Rig&&) = delete;

  btBroadphaseProxy* create(const btVector3& lower, const btVector3& upper, int group = 1,
                            int mask = all_bits, void* client = nullptr) {
    if (client == nullptr) client = this;
    proxies_.push_back(
        broadphase_->createProxy(lower, upper, BOX_SHAPE_PROXYTYPE, client, group, mask, &dispatcher_));
    return proxies_.back();
  }
  /// From x to x + 1, and from 0 to 1 on the other axes.
  btBroadphaseProxy* create_unit(btScalar x, int group = 1, int mask = all_bits, void* client = nullptr) {
    return create({x, 0, 0}, {x + 1, 1, 1}, group, mask, client);
  }
  void move(btBroadphaseProxy* proxy, const btVector3& lower, const btVector3& upper) {
    broadphase_->setAabb(proxy, lower, upper, &dispatcher_);
  }
  void move(btBroadphaseProxy* proxy, btScalar x) { move(proxy, {x, 0, 0}, {x + 1, 1, 1}); }
  void destroy(btBroadphaseProxy* proxy) {
    std::erase(proxies_, proxy);
    broadphase_->destroyProxy(proxy, &dispatcher_);
  }
  void calculate() { broadphase_->calculateOverlappingPairs(&dispatcher_); }
  /// Calculates until a pair has gone: some broad phases remove pairs late.
  void calculate_until_parted(const btBroadphaseProxy* s, const btBroadphaseProxy* t) {
    for (int k = 0; k < 200; ++k) {
      calculate();
      if (find(s, t) == nullptr) return;
    }
  }

  btBroadphasePair* find(const btBroadphaseProxy* s, const btBroadphaseProxy* t) {
    return test::find(cache(), s, t);
  }
  bool has(const btBroadphaseProxy* s, const btBroadphaseProxy* t) { return find(s, t) != nullptr; }
  int pair_count() { return cache().getNumOverlappingPairs(); }
  int missing() { return test::missing(cache(), proxies_); }
  /// The pairs of the cache, in its own order.
  std::vector<std::pair<int, int>> ids() {
    std::vector<std::pair<int, int>> result;
    const btBroadphasePairArray& pairs = cache().getOverlappingPairArray();
    result.reserve(static_cast<std::size_t>(pairs.size()));
    for (int k = 0; k < pairs.size(); ++k) {
      result.emplace_back(pairs[k].m_pProxy0->m_uniqueId, pairs[k].m_pProxy1->m_uniqueId);
    }
    return result;
  }

  btBroadphaseInterface& broadphase() { return *broadphase_; }
  btOverlappingPairCache& cache() { return *broadphase_->getOverlappingPairCache(); }
  btCollisionDispatcher& dispatcher() { return dispatcher_; }
  [[nodiscard]] const std::vector<btBroadphaseProxy*>& proxies() const { return proxies_; }

 private:
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  std::unique_ptr<btBroadphaseInterface> broadphase_;
  std::vector<btBroadphaseProxy*> proxies_;
};

/// Creates, destroys or moves a cube of edge 2; about 60 exist at a time.
/// @param range Of its lower corner.
inline void call_at_random(Rig& rig, Random& random, unsigned range) {
  const btVector3 lower = random.point(range);
  const btVector3 upper = lower + btVector3(2, 2, 2);
  if (rig.proxies().size() < 60) {
    rig.move(rig.create(lower, upper), lower, upper);
  } else if (random.below(6) == 0) {
    rig.destroy(rig.proxies()[random.below(60)]);
  } else {
    rig.move(rig.proxies()[random.below(60)], lower, upper);
  }
}

}  // namespace broadcl::test
