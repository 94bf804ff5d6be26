#pragma once

/// For Bullet programs, from C++17 on. To use broad_phase() of a BulletBroadphase, also include
/// broadcl/broad_phase.hpp, or broadcl/broad_phase64.hpp for double precision, which need C++20.

#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletCollision/BroadphaseCollision/btBroadphaseProxy.h>
#include <BulletCollision/CollisionDispatch/btCollisionObject.h>
#include <LinearMath/btScalar.h>
#include <LinearMath/btVector3.h>

#include <broadcl/export.h>
#include <broadcl/config.hpp>
#include <broadcl/error.hpp>

#if BT_BULLET_VERSION < 305
#error "BroadCL needs Bullet 3.05 or later; look for an older copy in the include path (docs/bullet.md)"
#endif

class btCollisionWorld;
class btOverlappingPairCache;

namespace broadcl {

struct Aabb;
struct Aabb64;
template <class Box>
class BasicBroadPhase;

namespace detail {

/// What a program's Bullet and the one of this library must have in common.
struct BulletAbi {
  int version;
  std::size_t vector_size, vector_alignment;
  std::size_t proxy_size, proxy_alignment;
  std::size_t object_size, object_alignment;
};

// Not inline: each file of the program and of the library must have its own.
constexpr BulletAbi bullet_abi{BT_BULLET_VERSION,          sizeof(btVector3),
                               alignof(btVector3),         sizeof(btBroadphaseProxy),
                               alignof(btBroadphaseProxy), sizeof(btCollisionObject),
                               alignof(btCollisionObject)};

}  // namespace detail

#ifdef BT_USE_DOUBLE_PRECISION
// If a program is linked against the library for the other precision, a symbol is undefined, instead of the
// layout being wrong.
inline namespace float64 {
#endif

/// A Bullet broad phase whose pairs are found by a BroadPhase or a BroadPhase64, on the host or on an OpenCL
/// device. Use it in place of a `btDbvtBroadphase`.
///
/// Overlaps are those of the exact boxes that Bullet sets, including boxes that only touch, as of
/// calculateOverlappingPairs(). A pair that continues to overlap keeps its entry in the pair cache and its
/// collision algorithm (but see set_shape_culling()). The order in which pairs are added and removed depends
/// only on the sequence of calls.
///
/// Groups and masks may be written in place. Their values at the time of the calculation count, also for
/// pairs that are already in the cache. The device tests them, unless the cache has an overlap filter
/// callback or its class is not one of Bullet's: then every overlapping pair is offered to the cache, and
/// pairs that are in it stay. Every pair enters the cache through addOverlappingPair(). A pair that the cache
/// refuses, or that somebody removed from it, is offered again by the next calculation after one of its two
/// proxies got another box, group or mask. (Removals by others are noticed by the number of pairs in the
/// cache, so not if as many are added in the same step.) If the callback is set, cleared or replaced, the
/// cache decides about every overlapping pair again.
///
/// If Bullet is built for double precision (BT_USE_DOUBLE_PRECISION, the target broadcl::bullet-float64), a
/// BroadPhase64 finds the pairs: exactly those of the boxes in double precision, at any distance from the
/// origin.
///
/// If the device fails, the error is reported once; that calculation and all later ones are done on the host,
/// by sweep and prune, and broad_phase().device() is null.
///
/// Nothing is thrown inside Bullet's step. If an allocation fails in a calculation or in setAabb(), the error
/// is reported, pairs may be missing or outdated, and the next calculation compares all pairs with the cache;
/// further failures are not reported until that has succeeded. If createProxy(), destroyProxy() or begin()
/// throws std::bad_alloc, it has changed nothing; destroyProxy() throws only if memory is exhausted twice in
/// a row after begin(). Queries without memory take longer, unless it is that of Bullet's allocator, which
/// Bullet never expects to fail.
///
/// The cost of a calculation depends on what changed since the last one; in addition, it reads each proxy's
/// group and mask.
///
/// A proxy with a NaN bound, or with a lower bound above the upper one, overlaps nothing until it gets a
/// valid box. A NaN bound is reported once each time that it appears.
///
/// Ray and box queries see every change at once. They search the tree that the calculations use, which has
/// all boxes after each of them; boxes that changed since are put into it when testing all proxies has taken
/// as long as that. Without memory for a tree, all proxies are tested. Queries may run in several threads at
/// the same time, and within one another, as long as no thread calls any other function.
class BROADCL_BULLET_API BulletBroadphase : public btBroadphaseInterface {
 public:
  /// What finds the pairs: a BroadPhase, or in double precision a BroadPhase64.
#ifdef BT_USE_DOUBLE_PRECISION
  using Core = BasicBroadPhase<Aabb64>;
#else
  using Core = BasicBroadPhase<Aabb>;
#endif

  /// Opens the device, unless the algorithm starts on the host: see Config::algorithm.
  /// @param config The device and the algorithm.
  /// @param cache Receives the pairs; not owned, must outlive this object. If null, the object makes its own:
  /// a btHashedOverlappingPairCache in which the cost of removing a proxy depends only on the pairs of that
  /// proxy.
  /// @param program Leave it out: describes the Bullet that the program is compiled with.
  /// @throws Error as BroadPhase does, and if that Bullet is not the one that the library was built with.
  explicit BulletBroadphase(const Config& config = Config(), btOverlappingPairCache* cache = nullptr,
                            const detail::BulletAbi& program = detail::bullet_abi);
  ~BulletBroadphase() override;
  BulletBroadphase(const BulletBroadphase&) = delete;
  BulletBroadphase& operator=(const BulletBroadphase&) = delete;
  BulletBroadphase(BulletBroadphase&&) = delete;
  BulletBroadphase& operator=(BulletBroadphase&&) = delete;

  /// The id of a proxy is unique among living proxies and constant for the proxy's lifetime. The lowest free
  /// id is used first.
  btBroadphaseProxy* createProxy(const btVector3& aabbMin, const btVector3& aabbMax, int shapeType,
                                 void* userPtr, int collisionFilterGroup, int collisionFilterMask,
                                 btDispatcher* dispatcher) override;
  /// Also removes the proxy's pairs from the cache.
  void destroyProxy(btBroadphaseProxy* proxy, btDispatcher* dispatcher) override;
  void setAabb(btBroadphaseProxy* proxy, const btVector3& aabbMin, const btVector3& aabbMax,
               btDispatcher* dispatcher) override;
  void getAabb(btBroadphaseProxy* proxy, btVector3& aabbMin, btVector3& aabbMax) const override;

  void rayTest(const btVector3& rayFrom, const btVector3& rayTo, btBroadphaseRayCallback& rayCallback,
               const btVector3& aabbMin = btVector3(0, 0, 0),
               const btVector3& aabbMax = btVector3(0, 0, 0)) override;
  void aabbTest(const btVector3& aabbMin, const btVector3& aabbMax,
                btBroadphaseAabbCallback& callback) override;

  /// Updates the pair cache: removals first, then additions, each in canonical order.
  void calculateOverlappingPairs(btDispatcher* dispatcher) override;

  /// Starts the next calculation on the device with the current boxes, and returns at once. If proxies are
  /// changed, created or destroyed before calculateOverlappingPairs(), that does a second update; its result
  /// is always the same as without begin(). No-op if a calculation was started already. In a btDynamicsWorld,
  /// stepSimulation() changes the boxes of moving bodies before it calculates, so begin() gains nothing,
  /// unless btDispatcherInfo::m_useContinuous is false. On the host, it gains nothing either.
  void begin();

  btOverlappingPairCache* getOverlappingPairCache() override;
  [[nodiscard]] const btOverlappingPairCache* getOverlappingPairCache() const override;

  /// The union of all non-empty boxes; a point at the origin if there is none.
  void getBroadphaseAabb(btVector3& aabbMin, btVector3& aabbMax) const override;

  /// If true, createProxy() and setAabb() add the pairs of a new box to the cache at once, for code that
  /// reads the cache between two calculations, as btKinematicCharacterController does. Pairs still end in the
  /// calculation. Each box that is set is then put into the tree of queries at once, and searched for, as
  /// with a btDbvtBroadphase. The default is false.
  void set_pairs_at_once(bool at_once) noexcept;

  /// Keeps pairs whose boxes overlap, but whose shapes do not, from the narrow phase. This makes frames
  /// shorter in dense crowds, and hardly otherwise.
  ///
  /// All overlapping pairs stay in the pair cache, for ghosts, islands and other readers. But a
  /// btCollisionDispatcher skips the near callback for pairs whose objects cannot touch: each object is
  /// bounded by a box that rotates with it, or by its own sphere or capsule, and a pair is skipped if these
  /// bounds are apart by more than the distance at which Bullet makes contacts. A skipped pair without
  /// contacts loses its collision algorithm until it is dispatched again; otherwise the algorithm stays as
  /// long as the boxes overlap. So the contacts are the same, but Bullet may list and solve them in another
  /// order.
  ///
  /// Culled shapes are btBoxShape, btSphereShape, btCapsuleShape, btCylinderShape, btConeShape,
  /// btMultiSphereShape and btConvexHullShape. Pairs with another shape, with a user's class derived from one
  /// of these, with a shape that is smaller than its margin or that has polyhedral features, with a kinematic
  /// object, or with an object that is not in the Bullet world are never skipped; nor is any pair if
  /// dispatching is continuous (btDispatcherInfo::DISPATCH_CONTINUOUS). Do not use this with your own
  /// collision algorithms if they make contacts at a larger distance than gContactBreakingThreshold allows.
  ///
  /// Shapes and transforms are read once per dispatch, so a near callback must not move objects. If you
  /// shrink a shape or lower gContactBreakingThreshold, a pair that was skipped may get its first contact at
  /// a smaller distance than without culling, since its manifold would have kept the old threshold then.
  /// @param world The Bullet world whose objects are culled; null, the default, for none. Not owned: call
  /// this with null before it is destroyed, if this object is used afterwards.
  /// @throws Error if this object does not control the dispatch: it was given a pair cache, or the Bullet
  /// world has another broad phase, or its dispatcher is a btCollisionDispatcherMt.
  void set_shape_culling(const btCollisionWorld* world);

  /// @param handler Called with one line that says what is wrong with a proxy, the device or memory. Must not
  /// be empty and must not throw. By default, errors are printed to stderr.
  void set_error_handler(std::function<void(const std::string&)> handler);

  /// Prints nothing; the caller can print what broad_phase() provides.
  void printStats() override {}

  /// The core that finds the pairs, for its device, algorithm and profile. It is replaced if the device
  /// fails.
  [[nodiscard]] const Core& broad_phase() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

#ifdef BT_USE_DOUBLE_PRECISION
}  // namespace float64
#endif
}  // namespace broadcl
