#pragma once

#include <BulletCollision/BroadphaseCollision/btBroadphaseProxy.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <LinearMath/btAabbUtil2.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include <broadcl/pair.hpp>

#include "bullet_random_script.hpp"

namespace broadcl::test {

[[nodiscard]] inline bool has_nan(const Corners& box) {
  for (int axis = 0; axis < 3; ++axis) {
    if (box.lower[axis] != box.lower[axis] || box.upper[axis] != box.upper[axis]) return true;
  }
  return false;
}

/// Whether a box has a NaN or is inverted. Bullet's own test finds overlaps of such boxes, too.
[[nodiscard]] inline bool is_invalid(const Corners& box) {
  return has_nan(box) || box.lower.x() > box.upper.x() || box.lower.y() > box.upper.y() ||
         box.lower.z() > box.upper.z();
}

[[nodiscard]] inline bool overlap(const Corners& s, const Corners& t) {
  return !is_invalid(s) && !is_invalid(t) && TestAabbAgainstAabb2(s.lower, s.upper, t.lower, t.upper);
}

[[nodiscard]] inline bool contains(const std::vector<Pair>& sorted, const Pair& pair) {
  return std::binary_search(sorted.begin(), sorted.end(), pair);
}

/// Pairs that entered the cache and pairs that left it.
struct CacheChanges {
  std::vector<Pair> added;
  std::vector<Pair> removed;
};

/// What a broad phase and its pair cache must hold by the definitions: boxes in a list, every pair tested,
/// and filtered as by Bullet's cache.
class BulletReference {
 public:
  explicit BulletReference(CacheKind cache) : cache_(cache) {}

  // The same calls as those of the broad phase.

  int create(const Corners& box, int group, int mask) {
    std::size_t id = 0;
    while (id < slots_.size() && slots_[id]) ++id;
    if (id == slots_.size()) slots_.emplace_back();
    Slot& slot = slots_[id].emplace();
    slot.box = box;
    slot.proxy.m_uniqueId = static_cast<int>(id);
    slot.proxy.m_collisionFilterGroup = slot.seen_group = group;
    slot.proxy.m_collisionFilterMask = slot.seen_mask = mask;
    if (has_nan(box)) ++nans_;
    return static_cast<int>(id);
  }
  void destroy(int id) {
    remove_pairs_of(id);
    std::erase_if(known_, [&](const Pair& pair) { return has_object(pair, id); });
    at(id) = std::nullopt;
  }
  void move(int id, const Corners& box) {
    Slot& slot = *at(id);
    if (has_nan(box) && !has_nan(slot.box)) ++nans_;
    const bool both_nan = has_nan(box) && has_nan(slot.box);
    const bool is_equal = box.lower == slot.box.lower && box.upper == slot.box.upper;
    slot.is_changed |= !both_nan && !is_equal;
    slot.box = box;
  }
  void write_filter(int id, int group, int mask) {
    at(id)->proxy.m_collisionFilterGroup = group;
    at(id)->proxy.m_collisionFilterMask = mask;
  }
  /// A null cache ignores it.
  void set_callback(btOverlapFilterCallback* callback) {
    if (cache_ != CacheKind::null) filter_.setOverlapFilterCallback(callback);
  }
  /// Does nothing until the next calculation if it was called before.
  void begin() {
    if (!std::exchange(is_begun_, true)) look_at_filters();
  }
  void calculate();

  // Changes that users make to the cache.

  void remove_pair(const Pair& pair) {
    if (std::erase(cached_, pair) > 0) changes_.removed.push_back(pair);
  }
  void remove_pairs_of(int id) {
    std::erase_if(cached_, [&](const Pair& pair) {
      if (has_object(pair, id)) changes_.removed.push_back(pair);
      return has_object(pair, id);
    });
  }

  void add_again(const Pair& pair) { changes_.added.push_back(pair); }

  // The expected state. Lists of pairs are in canonical order.

  [[nodiscard]] std::vector<int> live() const {
    std::vector<int> ids;
    for (std::size_t id = 0; id < slots_.size(); ++id) {
      if (slots_[id]) ids.push_back(static_cast<int>(id));
    }
    return ids;
  }
  [[nodiscard]] bool is_live(int id) const {
    const auto place = static_cast<std::size_t>(id);
    return place < slots_.size() && slots_[place].has_value();
  }
  [[nodiscard]] const Corners& box(int id) const { return slots_[static_cast<std::size_t>(id)]->box; }
  /// Pairs that overlap, as of the last calculation.
  [[nodiscard]] const std::vector<Pair>& overlapping() const noexcept { return overlapping_; }
  /// Those of them that the device must find.
  [[nodiscard]] const std::vector<Pair>& known() const noexcept { return known_; }
  [[nodiscard]] const std::vector<Pair>& cached() const noexcept { return cached_; }
  /// Whether the cache lets a pair in with the current filters.
  [[nodiscard]] bool may_enter(const Pair& pair) {
    return filter_.needsBroadphaseCollision(&proxy(pair.a), &proxy(pair.b));
  }
  /// How often a box with a NaN appeared.
  [[nodiscard]] int nans() const noexcept { return nans_; }
  /// The changes since the last call of this.
  [[nodiscard]] CacheChanges take_changes() { return std::exchange(changes_, {}); }

  [[nodiscard]] static bool has_object(const Pair& pair, int id) {
    return static_cast<int>(pair.a) == id || static_cast<int>(pair.b) == id;
  }

 private:
  struct Slot {
    btBroadphaseProxy proxy{};
    Corners box;
    int seen_group = 0;
    int seen_mask = 0;
    bool is_changed = true;  // since the last calculation
  };

  std::optional<Slot>& at(int id) { return slots_[static_cast<std::size_t>(id)]; }
  btBroadphaseProxy& proxy(std::uint32_t id) { return slots_[id]->proxy; }
  /// A group or mask that was written takes effect only when somebody looks.
  void look_at_filters();
  /// Whether only the cache knows how it filters, which decides when a pair is offered.
  [[nodiscard]] bool only_cache_knows() {
    return cache_ == CacheKind::users_class || filter_.getOverlapFilterCallback() != nullptr;
  }

  CacheKind cache_;
  btHashedOverlappingPairCache filter_;  // empty; it only says what it would let in
  btOverlapFilterCallback* seen_callback_ = nullptr;
  bool is_filtered_anew_ = false;
  bool is_begun_ = false;
  std::vector<std::optional<Slot>> slots_;
  std::vector<Pair> overlapping_;
  std::vector<Pair> known_;
  std::vector<Pair> cached_;
  CacheChanges changes_;
  int nans_ = 0;
};

inline void BulletReference::look_at_filters() {
  const bool is_new_callback = filter_.getOverlapFilterCallback() != seen_callback_;
  seen_callback_ = filter_.getOverlapFilterCallback();
  is_filtered_anew_ |= is_new_callback;
  for (std::optional<Slot>& slot : slots_) {
    if (!slot) continue;
    const btBroadphaseProxy& proxy = slot->proxy;
    slot->is_changed |= is_new_callback || slot->seen_group != proxy.m_collisionFilterGroup ||
                        slot->seen_mask != proxy.m_collisionFilterMask;
    slot->seen_group = proxy.m_collisionFilterGroup;
    slot->seen_mask = proxy.m_collisionFilterMask;
  }
}

// A pair that is cached stays. One that is not, although it overlapped at the last calculation, too, was
// refused or removed: it is offered again when one of its two objects has changed.
inline void BulletReference::calculate() {
  look_at_filters();
  const std::vector<Pair> known_before = std::exchange(known_, {});
  const std::vector<Pair> cached_before = std::exchange(cached_, {});
  overlapping_.clear();
  const std::vector<int> ids = live();
  std::vector<Corners> boxes;
  boxes.reserve(ids.size());
  for (const int id : ids) boxes.push_back(box(id));
  for (std::size_t t = 0; t < ids.size(); ++t) {
    for (std::size_t s = 0; s < t; ++s) {
      if (!overlap(boxes[s], boxes[t])) continue;
      const Pair pair{static_cast<std::uint32_t>(ids[s]), static_cast<std::uint32_t>(ids[t])};
      overlapping_.push_back(pair);
      if (!only_cache_knows() && !may_enter(pair)) continue;
      known_.push_back(pair);
      if (cache_ == CacheKind::null) continue;
      const bool was_cached = contains(cached_before, pair);
      const bool is_offered =
          !contains(known_before, pair) || at(ids[s])->is_changed || at(ids[t])->is_changed;
      const bool is_cached =
          is_filtered_anew_ ? may_enter(pair) : was_cached || (is_offered && may_enter(pair));
      if (is_cached) cached_.push_back(pair);
      if (is_cached && !was_cached) changes_.added.push_back(pair);
    }
  }
  for (const Pair& pair : cached_before) {
    if (!contains(cached_, pair)) changes_.removed.push_back(pair);
  }
  for (std::optional<Slot>& slot : slots_) {
    if (slot) slot->is_changed = false;
  }
  is_filtered_anew_ = is_begun_ = false;
}

}  // namespace broadcl::test
