#pragma once

#include <functional>
#include <memory>
#include <string>

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>

#include <broadcl/export.h>
#include <broadcl/broad_phase.hpp>

class btCollisionWorld;
class btOverlappingPairCache;

namespace broadcl {
#ifdef BT_USE_DOUBLE_PRECISION
// A program that is linked against the library for the other precision has an undefined symbol, not a wrong
// layout.
inline namespace float64 {
#endif

/// A Bullet broad phase whose pairs are found by a BroadPhase, on an OpenCL device. Use it in place of a
/// `btDbvtBroadphase`.
///
/// Overlaps are those of the exact boxes that Bullet sets, touching included, as of
/// calculateOverlappingPairs(). A pair that stays overlapped keeps its entry in the pair cache and its
/// collision algorithm (but see set_shape_culling()). The order in which pairs are added and removed depends
/// on the sequence of calls only.
///
/// Groups and masks may be written in place. Those at the time of the calculation count, for pairs in the
/// cache too. The device tests them, unless the cache has an overlap filter callback or is of a class of the
/// user's: then the cache is offered every overlapping pair. Every pair enters through addOverlappingPair().
/// A pair that the cache refuses, or that somebody removed from it, is offered again by the next calculation
/// after one of its two proxies got another box, group or mask. If the callback is set, cleared or exchanged,
/// the cache decides about every overlapping pair again.
///
/// If Bullet is built for double precision (BT_USE_DOUBLE_PRECISION, the target broadcl::bullet-float64), the
/// device has boxes in float32 that are rounded outward: every pair of exact boxes is found, and some that
/// are apart by less than the rounding. Bounds of proxies and queries stay exact.
///
/// If the device fails, this is reported once, and from that calculation on pairs are found on the host, by
/// sweep and prune: broad_phase().device() is null from then on.
///
/// Nothing is thrown inside Bullet's step. If an allocation fails in a calculation or in setAabb(), this is
/// reported, pairs may be missing or outdated, and the next calculation compares all pairs with the cache; it
/// is reported once until that has succeeded. createProxy(), destroyProxy() and begin() do all of their work
/// or throw std::bad_alloc and have changed nothing; destroyProxy() does so only if memory is exhausted twice
/// in a row after begin(). Queries need no memory.
///
/// A calculation costs as much as what changed since the last one, and a look at each proxy's group and mask.
///
/// A proxy with a NaN bound, or with a lower bound above the upper one, overlaps nothing until it gets a
/// proper box. A NaN bound is reported once each time it turns up.
///
/// Ray and box queries see every change at once, in a btDbvt of the boxes that is brought up to date only if
/// queries are made. They may run in several threads at once and from within one another, as long as no
/// thread calls anything else.
class BROADCL_BULLET_API BulletBroadphase : public btBroadphaseInterface {
 public:
  /// Opens the device.
  /// @param config The device and the algorithm.
  /// @param cache Gets the pairs; not owned, must outlive this object. If null, the object makes one of its
  ///   own: a btHashedOverlappingPairCache in which removing a proxy costs as much as the proxy has pairs.
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
  /// Removes the proxy's pairs from the cache, too.
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
  void calculateOverlappingPairs(btDispatcher* dispatcher) override;

  /// Starts the next calculation on the device with the boxes that are set, and returns at once. If something
  /// is set, created, destroyed or filtered meanwhile, calculateOverlappingPairs() does a second update for
  /// it; its result is always the same as without begin(). No-op if a calculation was started already.
  void begin();

  btOverlappingPairCache* getOverlappingPairCache() override;
  [[nodiscard]] const btOverlappingPairCache* getOverlappingPairCache() const override;

  /// The union of all boxes that are not empty; a point at the origin if there is none.
  void getBroadphaseAabb(btVector3& aabbMin, btVector3& aabbMax) const override;

  /// If true, createProxy() and setAabb() add the pairs of a new box to the cache at once, for those who look
  /// there between two calculations, as btKinematicCharacterController does. Pairs still end in the
  /// calculation. Every box that is set then costs an update of the tree for queries and a search in it, as
  /// with a btDbvtBroadphase. False at first.
  void set_pairs_at_once(bool at_once) noexcept;

  /// Keeps pairs of which the boxes overlap, but not the shapes, from the narrow phase. In dense crowds
  /// frames get shorter, otherwise hardly.
  ///
  /// All overlapping pairs stay in the pair cache, for ghosts, islands and everybody else who looks there.
  /// But a btCollisionDispatcher passes to its near callback only those pairs whose objects may touch: an
  /// object is bounded by a box that turns with it, or by a sphere or capsule if it is one, and the bounds of
  /// two must be apart by more than the distance at which Bullet makes contacts. A pair that is not passed
  /// on, and of which no contact is left, loses its collision algorithm until it is passed on again;
  /// otherwise an algorithm stays as long as boxes overlap. So contacts are the same, but Bullet may list and
  /// solve them in another order.
  ///
  /// That is so for btBoxShape, btSphereShape, btCapsuleShape, btCylinderShape, btConeShape,
  /// btMultiSphereShape and btConvexHullShape. Pairs with another shape, of a class that a user derived from
  /// one of these, or of an object that is not in the world are passed on always, and so are all pairs if
  /// dispatching is continuous (btDispatcherInfo::DISPATCH_CONTINUOUS). Do not use it with collision
  /// algorithms of your own that make contacts at a larger distance than gContactBreakingThreshold allows.
  /// @param world The one whose objects are culled; null for none, as at first. Not owned: call this with
  /// null
  ///   before it is destroyed if this object lives longer and is used again.
  /// @throws Error if somebody else walks the pairs: this object was given a pair cache, the world has
  /// another
  ///   broad phase, or its dispatcher is a btCollisionDispatcherMt.
  void set_shape_culling(const btCollisionWorld* world);

  /// @param handler Called with one line that says what is wrong with a proxy, the device or memory. Not
  ///   empty, and must not throw. Until this is called, errors are printed to stderr.
  void set_error_handler(std::function<void(const std::string&)> handler);

  /// Prints nothing: that is left to the caller, see broad_phase().
  void printStats() override {}

  /// The core underneath, for its device, algorithm and profile. After the device failed, it is another
  /// one.
  [[nodiscard]] const BroadPhase& broad_phase() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

#ifdef BT_USE_DOUBLE_PRECISION
}  // namespace float64
#endif
}  // namespace broadcl
