#include "bullet/shape_culling.hpp"

#include <BulletCollision/NarrowPhaseCollision/btPersistentManifold.h>

#include <algorithm>
#include <new>

namespace broadcl {

bool ShapeCulling::begin_dispatch() noexcept {
  if (world_ == nullptr) return false;
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
  manifolds_.resizeNoInitialize(0);
  if (pair.m_algorithm != nullptr) pair.m_algorithm->getAllContactManifolds(manifolds_);
  for (int k = 0; k < manifolds_.size(); ++k) {
    if (manifolds_[k]->getNumContacts() > 0) return false;  // only Bullet ends contacts
  }
  const Entry* s = find(*pair.m_pProxy0);
  if (s == nullptr) return false;
  const Entry* t = find(*pair.m_pProxy1);
  if (t == nullptr) return false;
  // Bullet does not process sleeping pairs.
  if ((!s->is_active && !t->is_active) || !are_apart(*s->bounds, *t->bounds, breaking_)) return false;
  for (int k = 0; k < manifolds_.size(); ++k) {
    // The manifold may be older than the shapes.
    if (manifolds_[k]->getContactBreakingThreshold() > largest_breaking(*s->bounds, *t->bounds)) return false;
  }
  return true;
}

const ShapeCulling::Entry* ShapeCulling::find(const btBroadphaseProxy& proxy) {
  const auto id = static_cast<std::uint32_t>(proxy.m_uniqueId);
  if (id >= entries_.size() || &pool_[id] != &proxy) return nullptr;  // somebody else's
  Entry& entry = entries_[id];
  if (entry.dispatch != dispatch_) {
    entry.dispatch = dispatch_;
    entry.bounds.reset();
    if (entry.owner == Owner::unknown) find_owner(proxy);
    if (entry.owner == Owner::world) {
      const auto& object = *static_cast<const btCollisionObject*>(proxy.m_clientObject);
      entry.is_active = object.isActive();
      entry.bounds = bounds_of(object, breaking_);
    }
  }
  return entry.bounds ? &entry : nullptr;
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
