#pragma once

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include <broadcl/pair.hpp>

#include "bullet_random_reference.hpp"
#include "bullet_random_script.hpp"

namespace broadcl::test {

/// Decides by the fields that users write in proxies, and by their ids.
struct Gate final : btOverlapFilterCallback {
  using Rule = bool (*)(const btBroadphaseProxy& s, const btBroadphaseProxy& t);
  explicit Gate(Rule r) : rule(r) {}
  bool needBroadphaseCollision(btBroadphaseProxy* s, btBroadphaseProxy* t) const override {
    return rule(*s, *t);
  }
  Rule rule;
};

inline std::array gates{
    Gate([](const auto& /*s*/, const auto& /*t*/) { return true; }),
    Gate([](const auto& /*s*/, const auto& /*t*/) { return false; }),
    Gate([](const auto& s, const auto& t) { return (s.m_uniqueId + t.m_uniqueId) % 2 == 0; }),
    Gate([](const auto& s, const auto& t) {
      return (s.m_collisionFilterGroup & t.m_collisionFilterGroup) != 0;
    }),
};

/// One of Bullet's own broad phases, used only for its overlaps: its cache lets all pairs in.
class Stock {
 public:
  Stock(btBroadphaseInterface& broadphase, btDispatcher& dispatcher)
      : broadphase_(broadphase), dispatcher_(dispatcher) {
    broadphase_.getOverlappingPairCache()->setOverlapFilterCallback(gates.data());
  }
  ~Stock() {
    for (std::size_t id = 0; id < proxies_.size(); ++id) {
      if (proxies_[id] != nullptr) destroy(static_cast<int>(id));
    }
  }
  Stock(const Stock&) = delete;
  Stock& operator=(const Stock&) = delete;
  Stock(Stock&&) = delete;
  Stock& operator=(Stock&&) = delete;

  void create(int id, const Corners& box) {
    const auto place = static_cast<std::size_t>(id);
    proxies_.resize(std::max(proxies_.size(), place + 1));
    proxies_[place] = broadphase_.createProxy(box.lower, box.upper, BOX_SHAPE_PROXYTYPE, &clients_[place], 1,
                                              -1, &dispatcher_);
  }
  void destroy(int id) {
    broadphase_.destroyProxy(std::exchange(proxies_[static_cast<std::size_t>(id)], nullptr), &dispatcher_);
  }
  void move(int id, const Corners& box) {
    broadphase_.setAabb(proxies_[static_cast<std::size_t>(id)], box.lower, box.upper, &dispatcher_);
  }
  /// The current pairs, by BroadCL's ids.
  std::vector<Pair> calculate() {
    broadphase_.calculateOverlappingPairs(&dispatcher_);
    std::vector<Pair> pairs;
    const btBroadphasePairArray& array = broadphase_.getOverlappingPairCache()->getOverlappingPairArray();
    for (int k = 0; k < array.size(); ++k) {
      const auto [a, b] = std::minmax({id_of(*array[k].m_pProxy0), id_of(*array[k].m_pProxy1)});
      pairs.push_back({a, b});
    }
    std::sort(pairs.begin(), pairs.end());
    return pairs;
  }

 private:
  [[nodiscard]] std::uint32_t id_of(const btBroadphaseProxy& proxy) const {
    return static_cast<std::uint32_t>(static_cast<const char*>(proxy.m_clientObject) - clients_.data());
  }

  btBroadphaseInterface& broadphase_;
  btDispatcher& dispatcher_;
  std::array<char, most_proxies> clients_{};
  std::vector<btBroadphaseProxy*> proxies_;  // by BroadCL's ids
};

/// A box that Bullet's tree can handle and that overlaps at least what the given one does: infinity minus
/// infinity and NaN would spoil the nodes above it.
[[nodiscard]] inline Corners for_tree(const Corners& box) {
  if (is_invalid(box)) return {{0, 0, 0}, {0, 0, 0}};
  Corners result = box;
  const btVector3 most(btScalar(1e18), btScalar(1e18), btScalar(1e18));
  for (btVector3* corner : {&result.lower, &result.upper}) {
    corner->setMax(-most);
    corner->setMin(most);
  }
  return result;
}

}  // namespace broadcl::test
