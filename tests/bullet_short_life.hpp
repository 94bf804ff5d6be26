#pragma once

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/CollisionDispatch/btCollisionDispatcher.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>
#include <LinearMath/btAabbUtil2.h>

#include <algorithm>
#include <cstddef>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

#include "twins.hpp"

namespace broadcl::test {

using IdPairs = std::vector<std::pair<int, int>>;

/// Proxies that are created, moved, filtered and destroyed in each frame, always the same way.
/// @tparam Trouble As for Twins.
template <class Trouble = NoTrouble>
class AdapterLife {
 public:
  /// @param cache May be null.
  explicit AdapterLife(std::string_view algorithm, btOverlappingPairCache* cache = nullptr,
                       bool at_once = false, const Trouble& trouble = {})
      : broadphase_({.algorithm = std::string(algorithm)}, cache), trouble_(trouble) {
    broadphase_.set_pairs_at_once(at_once);
    broadphase_.set_error_handler([this](const std::string& error) {
      ++error_count_;
      errors_.push_back(error);
    });
  }
  ~AdapterLife() {
    for (btBroadphaseProxy* proxy : proxies_) broadphase_.destroyProxy(proxy, &dispatcher_);
  }
  AdapterLife(const AdapterLife&) = delete;
  AdapterLife& operator=(const AdapterLife&) = delete;
  AdapterLife(AdapterLife&&) = delete;
  AdapterLife& operator=(AdapterLife&&) = delete;

  /// A few frames; in some, the next calculation begins early.
  void live() {
    for (int frame = 0; frame < 5; ++frame) {
      SCOPED_TRACE("frame " + std::to_string(frame));
      change();
      if (frame % 2 == 1) {
        call([&] { broadphase_.begin(); });
        change();
      }
      for (int k = 0; k < 5; ++k) expect_queries_find_all();
      call([&] { broadphase_.calculateOverlappingPairs(&dispatcher_); });
      broadphase_.calculateOverlappingPairs(&dispatcher_);  // nothing fails
      ASSERT_EQ(cached(), overlapping());
    }
  }

  void begin() { broadphase_.begin(); }

  /// Two frames in which one proxy moves.
  void rest() {
    for (const btScalar step : {btScalar(0.25), btScalar(-0.25)}) {
      btBroadphaseProxy& proxy = *proxies_[5];
      const btVector3 by(step, 0, 0);
      broadphase_.setAabb(&proxy, proxy.m_aabbMin + by, proxy.m_aabbMax + by, &dispatcher_);
      broadphase_.calculateOverlappingPairs(&dispatcher_);
      ASSERT_EQ(cached(), overlapping());
    }
  }

  /// The last proxy goes, and with it all pairs.
  void end() {
    while (!proxies_.empty()) destroy(proxies_.size() / 2);
    EXPECT_EQ(cached().size(), 0U);
  }

  [[nodiscard]] const Trouble& trouble() const { return trouble_; }
  [[nodiscard]] std::size_t error_count() const { return error_count_; }
  /// Those for whose text there was memory.
  [[nodiscard]] const std::vector<std::string>& errors() const { return errors_; }
  [[nodiscard]] bool is_on_device() const { return broadphase_.broad_phase().device() != nullptr; }
  [[nodiscard]] BulletBroadphase& broadphase() { return broadphase_; }
  [[nodiscard]] btDispatcher& dispatcher() { return dispatcher_; }

 private:
  /// Counts the proxies that a box query finds.
  struct Count final : btBroadphaseAabbCallback {
    bool process(const btBroadphaseProxy* /*proxy*/) override {
      ++found;
      return true;
    }
    std::size_t found = 0;
  };

  template <class Function>
  auto call(const Function& function) {
    return trouble_.call(function, [] {});
  }

  btVector3 corner() { return {static_cast<btScalar>(random_() % 50) / 10, btScalar(random_() % 2), 0}; }

  void create() {
    const btVector3 lower = corner();
    const auto group = static_cast<int>(1 + random_() % 2);
    btBroadphaseProxy* proxy = call([&] {
      return broadphase_.createProxy(lower, lower + btVector3(1, 1, 1), 0, this, group, 3, &dispatcher_);
    });
    EXPECT_EQ(proxy->m_uniqueId, lowest_free_id());
    proxies_.push_back(proxy);
  }

  void destroy(std::size_t k) {
    call([&] { broadphase_.destroyProxy(proxies_[k], &dispatcher_); });
    proxies_.erase(proxies_.begin() + static_cast<std::ptrdiff_t>(k));
  }

  void change() {
    for (std::size_t k = 0; k < proxies_.size(); k += 3) {
      const btVector3 lower = corner();
      call([&] { broadphase_.setAabb(proxies_[k], lower, lower + btVector3(1, 1, 1), &dispatcher_); });
    }
    for (std::size_t k = 0; k < proxies_.size(); k += 7) {
      proxies_[k]->m_collisionFilterMask ^= 1;
      destroy(k);
    }
    for (int k = 0; k < 12; ++k) create();
  }

  void expect_queries_find_all() {
    Count count;
    call([&] { broadphase_.aabbTest({-9, -9, -9}, {9, 9, 9}, count); });
    EXPECT_EQ(count.found, proxies_.size());
  }

  [[nodiscard]] int lowest_free_id() const {
    int id = 0;
    const auto has_id = [&](const btBroadphaseProxy* proxy) { return proxy->m_uniqueId == id; };
    while (std::any_of(proxies_.begin(), proxies_.end(), has_id)) ++id;
    return id;
  }

  IdPairs cached() {
    IdPairs pairs;
    const btBroadphasePairArray& array = broadphase_.getOverlappingPairCache()->getOverlappingPairArray();
    for (int k = 0; k < array.size(); ++k) {
      pairs.emplace_back(array[k].m_pProxy0->m_uniqueId, array[k].m_pProxy1->m_uniqueId);
    }
    std::sort(pairs.begin(), pairs.end());
    return pairs;
  }

  [[nodiscard]] IdPairs overlapping() const {
    IdPairs pairs;
    for (const btBroadphaseProxy* s : proxies_) {
      for (const btBroadphaseProxy* t : proxies_) {
        if (s->m_uniqueId < t->m_uniqueId &&
            TestAabbAgainstAabb2(s->m_aabbMin, s->m_aabbMax, t->m_aabbMin, t->m_aabbMax) &&
            (s->m_collisionFilterGroup & t->m_collisionFilterMask) != 0 &&
            (t->m_collisionFilterGroup & s->m_collisionFilterMask) != 0) {
          pairs.emplace_back(s->m_uniqueId, t->m_uniqueId);
        }
      }
    }
    std::sort(pairs.begin(), pairs.end());
    return pairs;
  }

  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  std::size_t error_count_ = 0;
  std::vector<std::string> errors_;
  BulletBroadphase broadphase_;
  Trouble trouble_;
  std::vector<btBroadphaseProxy*> proxies_;
  std::mt19937 random_{1};  // NOLINT(bugprone-random-generator-seed): the same life each time
};

}  // namespace broadcl::test
