#pragma once

#include <BulletCollision/BroadphaseCollision/btDispatcher.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <LinearMath/btAabbUtil2.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

#include "bullet_random_reference.hpp"
#include "bullet_random_script.hpp"
#include "mortal_algorithm.hpp"
#include "ray_callback.hpp"

namespace broadcl::test {

[[nodiscard]] inline std::string text(const Pair& pair) {
  return "(" + std::to_string(pair.a) + ", " + std::to_string(pair.b) + ")";
}

[[nodiscard]] inline Pair pair_of(const btBroadphaseProxy& s, const btBroadphaseProxy& t) {
  const auto [a, b] = std::minmax(s.m_uniqueId, t.m_uniqueId);
  return {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b)};
}

/// The pairs that are reported to ghosts.
struct GhostPairs final : btOverlappingPairCallback {
  btBroadphasePair* addOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t) override {
    added.push_back(pair_of(*s, *t));
    return nullptr;
  }
  void* removeOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t, btDispatcher* /*d*/) override {
    removed.push_back(pair_of(*s, *t));
    return nullptr;
  }
  void removeOverlappingPairsContainingProxy(btBroadphaseProxy* /*s*/, btDispatcher* /*d*/) override {
    fail("a proxy is reported to ghosts instead of pairs");
  }
  std::vector<Pair> added;
  std::vector<Pair> removed;
};

struct FoundByRay final : RayCallback {
  using RayCallback::RayCallback;
  bool process(const btBroadphaseProxy* proxy) override {
    ids.push_back(proxy->m_uniqueId);
    return false;  // this stops no query
  }
  std::vector<int> ids;
};

struct FoundByBox final : btBroadphaseAabbCallback {
  bool process(const btBroadphaseProxy* proxy) override {
    ids.push_back(proxy->m_uniqueId);
    return false;
  }
  std::vector<int> ids;
};

/// A cache whose way of filtering the broad phase cannot know.
class UsersClassOfCache final : public btHashedOverlappingPairCache {};

/// The broad phase under test with everything around it, and checks of it against a reference that got the
/// same calls. Each check throws if something is wrong.
class Subject {
 public:
  Subject(const std::string& algorithm, CacheKind kind, btDispatcher& dispatcher)
      : dispatcher_(dispatcher),
        users_cache_(make_cache(kind)),
        broadphase_({.algorithm = algorithm}, users_cache_.get()) {
    cache().setInternalGhostPairCallback(&ghosts_);
    broadphase_.set_error_handler([this](const std::string& error) {
      ++errors_;
      last_error_ = error;
    });
  }

  // The calls

  void create(int id, const Corners& box, int group, int mask) {
    btBroadphaseProxy* proxy =
        broadphase_.createProxy(box.lower, box.upper, BOX_SHAPE_PROXYTYPE, this, group, mask, &dispatcher_);
    if (proxy == nullptr || proxy->m_uniqueId != id)
      fail("the new proxy's id is not the lowest free one, " + std::to_string(id));
    if (proxy->m_clientObject != this) fail("the new proxy has another client");
    proxies_.resize(std::max(proxies_.size(), static_cast<std::size_t>(id) + 1));
    proxies_[static_cast<std::size_t>(id)] = proxy;
    check_box(id, box);
  }
  void destroy(int id) { broadphase_.destroyProxy(&proxy(id), &dispatcher_); }
  void move(int id, const Corners& box) {
    broadphase_.setAabb(&proxy(id), box.lower, box.upper, &dispatcher_);
    check_box(id, box);
  }
  void write_filter(int id, int group, int mask) {
    proxy(id).m_collisionFilterGroup = group;
    proxy(id).m_collisionFilterMask = mask;
  }
  void set_callback(btOverlapFilterCallback* callback) { cache().setOverlapFilterCallback(callback); }
  void remove_pair(const Pair& pair) {
    cache().removeOverlappingPair(&proxy(pair.a), &proxy(pair.b), &dispatcher_);
  }
  void remove_pairs_of(int id) { cache().removeOverlappingPairsContainingProxy(&proxy(id), &dispatcher_); }
  void clean_pairs_of(int id) {
    cache().cleanProxyFromPairs(&proxy(id), &dispatcher_);
    for (Marked& entry : marked_) {
      if (BulletReference::has_object(entry.pair, id)) entry.mark = nullptr;
    }
  }
  void add_again(const Pair& pair) {
    cache().addOverlappingPair(&proxy(pair.a), &proxy(pair.b));
    has_duplicates_ |= cache().hasDeferredRemoval();
  }
  void begin() { broadphase_.begin(); }
  void calculate() {
    broadphase_.calculateOverlappingPairs(&dispatcher_);
    has_duplicates_ = false;
  }
  void reset() { broadphase_.resetPool(&dispatcher_); }

  // The checks

  /// After every call.
  /// @param changes Since the last check.
  void check(const BulletReference& reference, CacheChanges changes) {
    auto& [added, removed] = changes;
    std::sort(added.begin(), added.end());
    std::sort(removed.begin(), removed.end());
    if (!removed.empty()) {
      std::erase_if(marked_, [&](const Marked& entry) { return contains(changes.removed, entry.pair); });
    }
    // Caches with deferred removal report no removal to ghosts, with any broad phase.
    if (cache().hasDeferredRemoval()) removed.clear();
    check_reported("added", std::exchange(ghosts_.added, {}), added);
    check_reported("removed", std::exchange(ghosts_.removed, {}), removed);
    const auto marks = std::count_if(marked_.begin(), marked_.end(),
                                     [](const Marked& entry) { return entry.mark != nullptr; });
    if (alive_ != marks) fail(std::to_string(alive_) + " algorithms live, expected " + std::to_string(marks));
    if (!has_duplicates_ && cache().getNumOverlappingPairs() != static_cast<int>(reference.cached().size())) {
      fail(std::to_string(cache().getNumOverlappingPairs()) + " pairs are cached, expected " +
           std::to_string(reference.cached().size()));
    }
    if (errors_ != reference.nans()) {
      fail("the error handler was called " + std::to_string(errors_) + " times for " +
           std::to_string(reference.nans()) + " boxes with NaN, at last with: " + last_error_);
    }
  }

  /// After a step; marks the pairs that are new.
  void check_pairs(const BulletReference& reference) {
    btBroadphasePairArray& pairs = cache().getOverlappingPairArray();
    const int n = pairs.size();
    std::vector<Marked> marked;
    for (int k = 0; k < n; ++k) {
      if (!is_live(reference, pairs[k].m_pProxy0) || !is_live(reference, pairs[k].m_pProxy1)) {
        fail("a proxy in the pair array is dead");
      }
      if (pairs[k].m_pProxy0->m_uniqueId >= pairs[k].m_pProxy1->m_uniqueId)
        fail("a pair's ids are not in order");
      const Pair pair = pair_of(*pairs[k].m_pProxy0, *pairs[k].m_pProxy1);
      const auto old = std::lower_bound(marked_.begin(), marked_.end(), pair,
                                        [](const Marked& entry, const Pair& p) { return entry.pair < p; });
      const bool is_new = old == marked_.end() || old->pair != pair;
      if (pairs[k].m_algorithm != (is_new ? nullptr : old->mark)) {
        fail(text(pair) + (is_new ? " is new and has an algorithm" : " lost its algorithm"));
      }
      if (!cache().hasDeferredRemoval() &&
          cache().findPair(pairs[k].m_pProxy0, pairs[k].m_pProxy1) != &pairs[k]) {
        fail(text(pair) + " is not found in its cache");
      }
      // Some pairs get none, as before the first dispatch.
      const bool is_marked = (pair.a + pair.b) % 4 != 0;
      if (is_marked && pairs[k].m_algorithm == nullptr) pairs[k].m_algorithm = make_mark();
      marked.push_back({pair, pairs[k].m_algorithm});
    }
    std::sort(marked.begin(), marked.end(), [](const Marked& s, const Marked& t) { return s.pair < t.pair; });
    marked_ = std::move(marked);
    std::vector<Pair> cached;
    for (const Marked& entry : marked_) cached.push_back(entry.pair);
    if (cached != reference.cached())
      fail("the cache has other pairs than the reference: " + difference(cached, reference.cached()));
  }

  /// What the core found; if the cache stores nothing, there is nothing else to check.
  void check_known(const BulletReference& reference) {
    const std::vector<Pair> known = broadphase_.broad_phase().pairs();
    const bool is_same =
        std::equal(known.begin(), known.end(), reference.known().begin(), reference.known().end());
    if (!is_same) fail("the core knows other pairs");
  }

  /// The union of all boxes.
  void check_bounds(const BulletReference& reference) {
    Corners expected{{0, 0, 0}, {0, 0, 0}};
    bool any = false;
    for (const int id : reference.live()) {
      const Corners& box = reference.box(id);
      if (is_invalid(box)) continue;
      if (!std::exchange(any, true)) expected = box;
      expected.lower.setMin(box.lower);
      expected.upper.setMax(box.upper);
    }
    Corners bounds;
    broadphase_.getBroadphaseAabb(bounds.lower, bounds.upper);
    if (bounds.lower != expected.lower || bounds.upper != expected.upper)
      fail("the union of all boxes is wrong");
  }

  void check_ray(const BulletReference& reference, const Corners& ends, const Corners& sweep) {
    const btVector3& from = ends.lower;
    const btVector3& to = ends.upper;
    FoundByRay found(from, to);
    broadphase_.rayTest(from, to, found, sweep.lower, sweep.upper);
    const auto must_be_found = [&](const Corners& box) {
      const std::array bounds{box.lower - sweep.upper, box.upper - sweep.lower};
      btScalar hit = 1;
      return !is_invalid(box) && btRayAabb2(from, found.m_rayDirectionInverse, found.m_signs, bounds.data(),
                                            hit, 0, found.m_lambda_max);
    };
    const auto may_be_found = [](const Corners& box) { return !is_invalid(box); };
    check_found("the ray", reference, std::move(found.ids), must_be_found, may_be_found);
  }

  void check_box_query(const BulletReference& reference, const Corners& query) {
    FoundByBox found;
    broadphase_.aabbTest(query.lower, query.upper, found);
    const auto must_be_found = [&](const Corners& box) { return overlap(box, query); };
    const auto may_be_found = [&](const Corners& box) { return overlap(box, query); };
    check_found("the box query", reference, std::move(found.ids), must_be_found, may_be_found);
  }

  /// After all proxies were destroyed.
  void check_end() {
    if (alive_ != 0) fail("algorithms outlive their proxies");
    if (cache().getNumOverlappingPairs() != 0) fail("pairs outlive their proxies");
  }

  /// The pairs of the cache, in its own order.
  [[nodiscard]] std::vector<Pair> pairs() {
    std::vector<Pair> result;
    const btBroadphasePairArray& array = cache().getOverlappingPairArray();
    result.reserve(static_cast<std::size_t>(array.size()));
    for (int k = 0; k < array.size(); ++k)
      result.push_back(pair_of(*array[k].m_pProxy0, *array[k].m_pProxy1));
    return result;
  }

 private:
  struct Marked {
    Pair pair;
    btCollisionAlgorithm* mark;  // may be null
  };

  static std::unique_ptr<btOverlappingPairCache> make_cache(CacheKind kind) {
    switch (kind) {
      case CacheKind::hashed:
        return std::make_unique<btHashedOverlappingPairCache>();
      case CacheKind::users_class:
        return std::make_unique<UsersClassOfCache>();
      case CacheKind::sorted:
        return std::make_unique<btSortedOverlappingPairCache>();
      case CacheKind::null:
        return std::make_unique<btNullPairCache>();
      case CacheKind::own:
        break;
    }
    return nullptr;
  }

  btOverlappingPairCache& cache() { return *broadphase_.getOverlappingPairCache(); }
  template <class Id>
  btBroadphaseProxy& proxy(Id id) {
    return *proxies_[static_cast<std::size_t>(id)];
  }
  btCollisionAlgorithm* make_mark() {
    ++alive_;
    return MortalAlgorithm::make(dispatcher_, [this] { --alive_; });
  }

  bool is_live(const BulletReference& reference, const btBroadphaseProxy* proxy) {
    const int id = proxy == nullptr ? -1 : proxy->m_uniqueId;
    return id >= 0 && reference.is_live(id) && proxy == proxies_[static_cast<std::size_t>(id)];
  }

  void check_box(int id, const Corners& box) {
    const auto same = [](const btVector3& s, const btVector3& t) {
      for (int axis = 0; axis < 3; ++axis) {
        if (s[axis] != t[axis] && (s[axis] == s[axis] || t[axis] == t[axis])) return false;
      }
      return true;
    };
    Corners is;
    broadphase_.getAabb(&proxy(id), is.lower, is.upper);
    if (!same(is.lower, box.lower) || !same(is.upper, box.upper) || !same(proxy(id).m_aabbMin, box.lower) ||
        !same(proxy(id).m_aabbMax, box.upper)) {
      fail("proxy " + std::to_string(id) + " has another box than it was given");
    }
  }

  /// The first difference of two lists.
  [[nodiscard]] static std::string difference(const std::vector<Pair>& is,
                                              const std::vector<Pair>& expected) {
    const auto [place, other] = std::mismatch(is.begin(), is.end(), expected.begin(), expected.end());
    return std::to_string(is.size()) + ", expected " + std::to_string(expected.size()) +
           "; the first that differs is " + (place == is.end() ? "none" : text(*place)) + ", expected " +
           (other == expected.end() ? "none" : text(*other));
  }

  static void check_reported(const std::string& what, std::vector<Pair> is,
                             const std::vector<Pair>& expected) {
    std::sort(is.begin(), is.end());
    if (is != expected)
      fail("other pairs were reported to ghosts as " + what + ": " + difference(is, expected));
  }

  template <class Must, class May>
  static void check_found(const std::string& who, const BulletReference& reference, std::vector<int> found,
                          const Must& must_be_found, const May& may_be_found) {
    std::sort(found.begin(), found.end());
    if (std::adjacent_find(found.begin(), found.end()) != found.end()) fail(who + " finds a proxy twice");
    for (const int id : found) {
      if (!reference.is_live(id)) fail(who + " finds a dead proxy");
      if (!may_be_found(reference.box(id))) fail(who + " finds proxy " + std::to_string(id));
    }
    for (const int id : reference.live()) {
      if (must_be_found(reference.box(id)) && !std::binary_search(found.begin(), found.end(), id)) {
        fail(who + " misses proxy " + std::to_string(id));
      }
    }
  }

  btDispatcher& dispatcher_;
  GhostPairs ghosts_;
  int alive_ = 0;   // marks
  int errors_ = 0;  // calls of the error handler
  std::string last_error_;
  std::unique_ptr<btOverlappingPairCache> users_cache_;
  BulletBroadphase broadphase_;
  std::vector<btBroadphaseProxy*> proxies_;  // by id
  std::vector<Marked> marked_;  // as of the last step, without those gone since; in canonical order
  bool has_duplicates_ = false;
};

}  // namespace broadcl::test
