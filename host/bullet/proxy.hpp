#pragma once

#include <BulletCollision/BroadphaseCollision/btBroadphaseProxy.h>

#include <cstdint>
#include <limits>

#include <broadcl/aabb.hpp>

namespace broadcl {

/// A proxy, and what the adapter remembers of it.
struct Proxy : btBroadphaseProxy {
  Proxy() {
    m_uniqueId = no_id;
    m_collisionFilterGroup = 0;
    m_collisionFilterMask = 0;
  }

  static constexpr int no_id = -1;  ///< Of a slot that is free.

  [[nodiscard]] bool is_live() const noexcept { return m_uniqueId != no_id; }
  [[nodiscard]] std::uint32_t id() const noexcept { return static_cast<std::uint32_t>(m_uniqueId); }

  // Users write m_collisionFilterGroup and m_collisionFilterMask in place: these are the values last seen.
  int seen_group = 0;
  int seen_mask = 0;
  std::uint32_t created = 0;  ///< Number of calculations before it was created.
  std::uint32_t changed = 0;  ///< Number of calculations before its box or filter was last changed.
  bool is_predicted = false;  ///< The core has another box than the proxy: one that begin() predicted.
};

[[nodiscard]] inline Aabb to_aabb(const btVector3& lower, const btVector3& upper) {
  return {{lower.x(), lower.y(), lower.z()}, {upper.x(), upper.y(), upper.z()}};
}

/// The proxy's box. One with a NaN bound overlaps nothing, so an empty box stands for it, which equals
/// itself.
[[nodiscard]] inline Aabb box_of(const btVector3& lower, const btVector3& upper) {
  const Aabb box = to_aabb(lower, upper);
  constexpr float infinity = std::numeric_limits<float>::infinity();
  return has_nan(box) ? Aabb{{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}} : box;
}

[[nodiscard]] inline Aabb box_of(const btBroadphaseProxy& proxy) {
  return box_of(proxy.m_aabbMin, proxy.m_aabbMax);
}

}  // namespace broadcl
