#include "scenes/verify.hpp"

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/CollisionDispatch/btCollisionWorld.h>

#include <algorithm>
#include <broadcl/broad_phase.hpp>
#include <cstdint>
#include <iterator>
#include <span>
#include <unordered_map>
#include <vector>

namespace broadcl::scenes {
namespace {

using Proxies = std::span<btBroadphaseProxy* const>;

std::vector<btBroadphaseProxy*> proxies_of(btCollisionWorld& world) {
  std::vector<btBroadphaseProxy*> proxies;
  const btCollisionObjectArray& objects = world.getCollisionObjectArray();
  proxies.reserve(static_cast<std::size_t>(objects.size()));
  for (int k = 0; k < objects.size(); ++k) proxies.push_back(objects[k]->getBroadphaseHandle());
  return proxies;
}

/// A box with a NaN bound overlaps nothing, so it becomes an empty one.
Aabb box_of(const btBroadphaseInterface& broadphase, btBroadphaseProxy& proxy) {
  btVector3 lower;
  btVector3 upper;
  broadphase.getAabb(&proxy, lower, upper);
  const Aabb box = {{lower.x(), lower.y(), lower.z()}, {upper.x(), upper.y(), upper.z()}};
  return has_nan(box) ? empty_aabb() : box;
}

bool pass_filters(const btBroadphaseProxy& s, const btBroadphaseProxy& t) {
  return (s.m_collisionFilterGroup & t.m_collisionFilterMask) != 0 &&
         (t.m_collisionFilterGroup & s.m_collisionFilterMask) != 0;
}

std::vector<Pair> expected_pairs(Proxies proxies, std::span<const Aabb> boxes) {
  std::vector<Pair> pairs = overlapping_pairs(boxes, {}, {.algorithm = "oracle"});
  std::erase_if(pairs, [&](const Pair& pair) { return !pass_filters(*proxies[pair.a], *proxies[pair.b]); });
  return pairs;
}

/// A pair's proxy that is not among `proxies` gets an id beyond all others.
std::vector<Pair> cached_pairs(btOverlappingPairCache& cache, Proxies proxies) {
  std::unordered_map<const btBroadphaseProxy*, std::uint32_t> ids;
  for (const btBroadphaseProxy* proxy : proxies) ids.emplace(proxy, static_cast<std::uint32_t>(ids.size()));
  const auto unknown = static_cast<std::uint32_t>(ids.size());
  const auto id_of = [&](const btBroadphaseProxy* proxy) {
    const auto entry = ids.find(proxy);
    return entry != ids.end() ? entry->second : unknown;
  };
  std::vector<Pair> pairs;
  const btBroadphasePairArray& cached = cache.getOverlappingPairArray();
  for (int k = 0; k < cached.size(); ++k) {
    const auto [a, b] = std::minmax({id_of(cached[k].m_pProxy0), id_of(cached[k].m_pProxy1)});
    pairs.push_back({a, b});
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

std::size_t count_of_difference(const std::vector<Pair>& from, const std::vector<Pair>& subtracted) {
  std::vector<Pair> rest;
  std::set_difference(from.begin(), from.end(), subtracted.begin(), subtracted.end(),
                      std::back_inserter(rest));
  return rest.size();
}

}  // namespace

Difference difference(const std::vector<Pair>& pairs, const std::vector<Pair>& expected) {
  return {.missing = count_of_difference(expected, pairs), .extra = count_of_difference(pairs, expected)};
}

Difference verify(btOverlappingPairCache& cache, Proxies proxies, std::span<const Aabb> boxes) {
  return difference(cached_pairs(cache, proxies), expected_pairs(proxies, boxes));
}

Difference verify(btCollisionWorld& world) {
  btBroadphaseInterface& broadphase = *world.getBroadphase();
  const std::vector<btBroadphaseProxy*> proxies = proxies_of(world);
  std::vector<Aabb> boxes;
  boxes.reserve(proxies.size());
  for (btBroadphaseProxy* proxy : proxies) boxes.push_back(box_of(broadphase, *proxy));
  return verify(*broadphase.getOverlappingPairCache(), proxies, boxes);
}

}  // namespace broadcl::scenes
