#pragma once

#include <BulletCollision/BroadphaseCollision/btCollisionAlgorithm.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/CollisionDispatch/btCollisionWorld.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/prefetch.hpp"
#include "bullet/proxy_pool.hpp"
#include "bullet/shape_bounds.hpp"

namespace broadcl {

/// Decides which pairs need no narrow phase, because the shapes of their objects are apart, though their
/// boxes overlap. Only objects of one world are culled. Shapes and transforms are read during the dispatch,
/// once per object.
class ShapeCulling {
 public:
  /// @param pool Must outlive this object.
  explicit ShapeCulling(const ProxyPool& pool) : pool_(pool) { manifolds_.reserve(1); }

  /// @param world Must not be destroyed while this object uses it; null to cull nothing.
  void set_world(const btCollisionWorld* world) {
    world_ = world;
    entries_.clear();
  }

  /// To be called when a proxy is created.
  void forget(std::uint32_t id) noexcept {
    if (id < entries_.size()) entries_[id] = Entry();
  }

  /// Starts a dispatch, for which all objects may have moved.
  /// @returns Whether to call is_idle() for each pair: not if the dispatcher is that of another world, or if
  /// there is no memory.
  bool begin_dispatch(const btDispatcher* dispatcher) noexcept;

  /// Prefetch what is_idle() needs for a pair: first the entries of its objects, then the objects.
  void prefetch_known(const btBroadphasePair& pair) const noexcept {
    for (const btBroadphaseProxy* proxy : {pair.m_pProxy0, pair.m_pProxy1}) {
      const auto id = static_cast<std::uint32_t>(proxy->m_uniqueId);
      if (id < entries_.size()) prefetch(&entries_[id], sizeof(Entry));
    }
  }
  void prefetch_objects(const btBroadphasePair& pair) const noexcept {
    for (const btBroadphaseProxy* proxy : {pair.m_pProxy0, pair.m_pProxy1}) {
      const auto id = static_cast<std::uint32_t>(proxy->m_uniqueId);
      if (id < entries_.size() && entries_[id].dispatch != dispatch_) {
        prefetch(proxy->m_clientObject, sizeof(btCollisionObject));
      }
    }
  }

  /// Whether the objects of a pair are apart and have no contact left.
  [[nodiscard]] bool is_idle(const btBroadphasePair& pair);

 private:
  enum class Owner : std::uint8_t { unknown, world, another };

  /// What is known about a proxy.
  struct Entry {
    Owner owner = Owner::unknown;  // of its object
    bool is_active = false;
    bool is_known = false;       // whether the bounds are right
    std::uint32_t dispatch = 0;  // for which the rest is right
    const btCollisionObject* object = nullptr;
    std::optional<ShapeBounds> bounds;
  };

  /// Null for a proxy whose object is not in the world.
  Entry* find(const btBroadphaseProxy& proxy);
  bool is_bounded(Entry& entry) const;
  void find_owner(const btBroadphaseProxy& proxy);

  const ProxyPool& pool_;
  const btCollisionWorld* world_ = nullptr;
  std::vector<Entry> entries_;  // by id
  std::uint32_t dispatch_ = 0;
  btScalar breaking_ = 0;      // gContactBreakingThreshold in this dispatch
  btManifoldArray manifolds_;  // of the current pair
};

}  // namespace broadcl
