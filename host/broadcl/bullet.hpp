#pragma once

#include <memory>

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>

#include <broadcl/broad_phase.hpp>

class btOverlappingPairCache;

namespace broadcl {

/// A Bullet broad phase whose pairs are found by a BroadPhase, on an OpenCL device: use it where a
/// `btDbvtBroadphase` stands.
///
/// Overlaps are those of the exact boxes that Bullet sets, touching included, as of
/// calculateOverlappingPairs(). A pair that stays overlapped keeps its entry in the pair cache and its
/// collision algorithm. Filters are asked when a pair forms. The order in which pairs are added and removed
/// depends on the sequence of calls only.
///
/// A proxy with a NaN bound, or with a lower bound above the upper one, overlaps nothing until it gets a
/// proper box.
///
/// Ray and box queries see every change at once and visit all proxies.
class BulletBroadphase : public btBroadphaseInterface {
 public:
  /// Opens the device.
  /// @param config The device and the algorithm.
  /// @param cache Where pairs go; not owned, must outlive this object. Where null, a
  /// btHashedOverlappingPairCache of
  ///   its own is used.
  /// @throws Error as BroadPhase does.
  explicit BulletBroadphase(const BroadPhase::Config& config = BroadPhase::Config(),
                            btOverlappingPairCache* cache = nullptr);
  ~BulletBroadphase() override;
  BulletBroadphase(const BulletBroadphase&) = delete;
  BulletBroadphase& operator=(const BulletBroadphase&) = delete;
  BulletBroadphase(BulletBroadphase&&) = delete;
  BulletBroadphase& operator=(BulletBroadphase&&) = delete;

  /// Ids of proxies are unique among those alive, constant for a proxy's life and reused lowest first.
  btBroadphaseProxy* createProxy(const btVector3& aabbMin, const btVector3& aabbMax, int shapeType,
                                 void* userPtr, int collisionFilterGroup, int collisionFilterMask,
                                 btDispatcher* dispatcher) override;
  /// Removes the proxy's pairs from the cache first.
  void destroyProxy(btBroadphaseProxy* proxy, btDispatcher* dispatcher) override;
  void setAabb(btBroadphaseProxy* proxy, const btVector3& aabbMin, const btVector3& aabbMax,
               btDispatcher* dispatcher) override;
  void getAabb(btBroadphaseProxy* proxy, btVector3& aabbMin, btVector3& aabbMax) const override;

  void rayTest(const btVector3& rayFrom, const btVector3& rayTo, btBroadphaseRayCallback& rayCallback,
               const btVector3& aabbMin = btVector3(0, 0, 0),
               const btVector3& aabbMax = btVector3(0, 0, 0)) override;
  void aabbTest(const btVector3& aabbMin, const btVector3& aabbMax,
                btBroadphaseAabbCallback& callback) override;

  /// Brings the pair cache up to date: removals first, then additions, each in canonical order.
  /// @throws Error when the device fails; the cache and the proxies are then as before.
  void calculateOverlappingPairs(btDispatcher* dispatcher) override;

  btOverlappingPairCache* getOverlappingPairCache() override;
  [[nodiscard]] const btOverlappingPairCache* getOverlappingPairCache() const override;

  /// The union of all boxes that are not empty; a point at the origin where there is none.
  void getBroadphaseAabb(btVector3& aabbMin, btVector3& aabbMax) const override;

  /// Nothing: printing is left to the caller, see broad_phase().
  void printStats() override {}

  /// The core underneath, for its device, algorithm and profile.
  [[nodiscard]] const BroadPhase& broad_phase() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace broadcl
