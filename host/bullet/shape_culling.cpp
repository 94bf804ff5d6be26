#include "bullet/shape_culling.hpp"

#include <BulletCollision/NarrowPhaseCollision/btPersistentManifold.h>

#include <algorithm>
#include <new>

namespace broadcl {

bool ShapeCulling::begin_dispatch(const btDispatcher* dispatcher) noexcept {
  // (Worlds may share a broad phase: each dispatches all pairs.)
  if (world_ == nullptr || world_->getDispatcher() != dispatcher) return false;
  try {
    entries_.resize(pool_.slots());
  } catch (const std::bad_alloc&) {
    return false;
  }
  ++dispatch_;
  breaking_ = gContactBreakingThreshold;
  return true;
}

bool ShapeCulling::is_idle(const btBroadphasePair& pair) {
  Entry* s = find(*pair.m_pProxy0);
  Entry* t = find(*pair.m_pProxy1);
  if (s == nullptr || t == nullptr) return false;
  if (!s->is_active && !t->is_active) return false;  // Bullet skips them, and does not look at their shapes
  if (!is_bounded(*s) || !is_bounded(*t)) return false;
  // (Some algorithms of soft bodies return manifolds that do not exist.)
  manifolds_.resizeNoInitialize(0);
  if (pair.m_algorithm != nullptr) pair.m_algorithm->getAllContactManifolds(manifolds_);
  for (int k = 0; k < manifolds_.size(); ++k) {
    if (manifolds_[k]->getNumContacts() > 0) return false;  // only Bullet ends contacts
  }
  if (!are_apart(*s->bounds, *t->bounds, breaking_)) return false;
  for (int k = 0; k < manifolds_.size(); ++k) {
    // The manifold may be older than the shapes.
    if (manifolds_[k]->getContactBreakingThreshold() > largest_breaking(*s->bounds, *t->bounds)) return false;
  }
  return true;
}

ShapeCulling::Entry* ShapeCulling::find(const btBroadphaseProxy& proxy) {
  const auto id = static_cast<std::uint32_t>(proxy.m_uniqueId);
  if (id >= entries_.size() || &pool_[id] != &proxy) return nullptr;  // somebody else's
  Entry& entry = entries_[id];
  if (entry.dispatch != dispatch_) {
    entry.dispatch = dispatch_;
    if (entry.owner == Owner::unknown) find_owner(proxy);
    entry.object =
        entry.owner == Owner::world ? static_cast<const btCollisionObject*>(proxy.m_clientObject) : nullptr;
    entry.is_active = entry.object != nullptr && entry.object->isActive();
    entry.is_known = false;
  }
  return entry.object != nullptr ? &entry : nullptr;
}

bool ShapeCulling::is_bounded(Entry& entry) const {
  if (!entry.is_known) {
    entry.is_known = true;
    entry.bounds.reset();
    // With a manifold, even an empty one, a kinematic object keeps others awake.
    if (!entry.object->isKinematicObject()) entry.bounds = bounds_of(*entry.object, breaking_);
  }
  return entry.bounds.has_value();
}

/// Objects that are new in the world are the last ones there.
void ShapeCulling::find_owner(const btBroadphaseProxy& proxy) {
  const btCollisionObjectArray& objects = world_->getCollisionObjectArray();
  for (int k = objects.size() - 1; k >= 0; --k) {
    const btBroadphaseProxy* other = objects[k]->getBroadphaseHandle();
    if (other == nullptr || other->m_clientObject != objects[k]) continue;
    const auto id = static_cast<std::uint32_t>(other->m_uniqueId);
    if (id < entries_.size() && &pool_[id] == other) entries_[id].owner = Owner::world;
    if (other == &proxy) return;
  }
  for (Entry& entry : entries_) {
    if (entry.owner == Owner::unknown) entry.owner = Owner::another;
  }
}

}  // namespace broadcl
