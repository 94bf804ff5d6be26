#pragma once

#include <BulletCollision/BroadphaseCollision/btBroadphaseProxy.h>

#include <cstdint>

#include <broadcl/aabb.hpp>

namespace broadcl {

/// A proxy, and what the adapter stores about it. In single precision this is one cache line, because all
/// proxies are read to detect what users wrote in place.
struct alignas(64) Proxy : btBroadphaseProxy {
  Proxy() {
    m_uniqueId = no_id;
    m_collisionFilterGroup = 0;
    m_collisionFilterMask = 0;
  }

  static constexpr int no_id = -1;  ///< Of a slot that is free.

  [[nodiscard]] bool is_live() const noexcept { return m_uniqueId != no_id; }
  [[nodiscard]] std::uint32_t id() const noexcept { return static_cast<std::uint32_t>(m_uniqueId); }

  // The number of the calculation that comes next, or 0 if that is long ago, at the time when
  std::uint32_t created = 0;  ///< it was created;
  std::uint32_t changed = 0;  ///< its box or filter was last changed.
};

/// The group and mask of a proxy. Users write them in place.
struct Masks {
  int group = 0;
  int mask = 0;
  bool operator==(const Masks&) const = default;
};

[[nodiscard]] inline Masks masks_of(const btBroadphaseProxy& proxy) noexcept {
  return {proxy.m_collisionFilterGroup, proxy.m_collisionFilterMask};
}

[[nodiscard]] inline bool has_nan(const btVector3& lower, const btVector3& upper) noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    if (lower[axis] != lower[axis] || upper[axis] != upper[axis]) return true;
  }
  return false;
}

/// Ignores the fourth component, which Bullet leaves undefined.
[[nodiscard]] inline bool is_same(const btVector3& s, const btVector3& t) noexcept {
  return s.x() == t.x() && s.y() == t.y() && s.z() == t.z();
}

/// Whether two closed boxes share a point. False if a bound is NaN.
[[nodiscard]] inline bool overlaps(const btVector3& lower_s, const btVector3& upper_s,
                                   const btVector3& lower_t, const btVector3& upper_t) noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    if (!detail::meet(lower_s[axis], upper_s[axis], lower_t[axis], upper_t[axis])) return false;
  }
  return true;
}

/// Whether the lower bound is at most the upper one on every axis. A box for which this is false overlaps
/// nothing.
[[nodiscard]] inline bool is_proper(const btVector3& lower, const btVector3& upper) noexcept {
  return lower.x() <= upper.x() && lower.y() <= upper.y() && lower.z() <= upper.z();
}

[[nodiscard]] inline bool is_proper(const btBroadphaseProxy& proxy) noexcept {
  return is_proper(proxy.m_aabbMin, proxy.m_aabbMax);
}

/// A box in Bullet's precision.
#ifdef BT_USE_DOUBLE_PRECISION
using ProxyBox = Aabb64;
[[nodiscard]] constexpr ProxyBox empty_box() noexcept {
  return empty_aabb64();
}
#else
using ProxyBox = Aabb;
[[nodiscard]] constexpr ProxyBox empty_box() noexcept {
  return empty_aabb();
}
#endif

[[nodiscard]] inline ProxyBox proper_box(const btVector3& lower, const btVector3& upper) noexcept {
  return {{lower.x(), lower.y(), lower.z()}, {upper.x(), upper.y(), upper.z()}};
}

[[nodiscard]] inline ProxyBox box_of(const btBroadphaseProxy& proxy) noexcept {
  return is_proper(proxy) ? proper_box(proxy.m_aabbMin, proxy.m_aabbMax) : empty_box();
}

}  // namespace broadcl
