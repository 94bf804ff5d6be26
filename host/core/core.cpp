#include "core/core.hpp"

#include <atomic>
#include <functional>
#include <optional>
#include <string>
#include <tuple>

#include <broadcl/error.hpp>

#include "base/box_parts.hpp"
#include "base/box_replacement.hpp"
#include "base/pair_lists.hpp"
#include "core/box_moves.hpp"
#include "core/exclusions.hpp"

namespace broadcl {

template <class Function>
void Core::or_find_boxes(const Function& function) {
  try {
    function();
  } catch (...) {
    boxes_ = algorithm_->boxes();
    throw;
  }
}

template <class Function>
void Core::or_roll_back(const Function& function) {
  try {
    function();
  } catch (...) {
    boxes_ = algorithm_->boxes();
    update_ = Update::none;
    changes_.insert(flight_);
    changes_.all = changes_.all_filters = true;
    flight_.clear();
    throw;
  }
}

template <class SetBox>
void Core::set_ids(std::size_t n, const Aabb& empty, const SetBox& set) noexcept {
  const auto removed = [&](std::uint32_t id) {
    changes_.recycle(id);
    set(id, packed_empty());
  };
  const auto added = [&](std::uint32_t id) {
    set(id, empty);
    changes_.recycle(id);
    store_filter(id, Filter());
  };
  objects_.set_ids(n, removed, added);
}

template <class Function>
void Core::replace_all(const BoxView& view, const Function& end) {
  const std::size_t n = view.size();
  reserve_all(n);
  or_find_boxes([&] {
    (void)algorithm_->spare_boxes();
    algorithm_->reserve_exclusions(exclusions_.size());  // which may move boxes, before they are written
  });
  const std::size_t slots = objects_.slots();
  const bool same_ids = objects_.size() == n && slots == n;
  std::optional<std::pair<ObjectTable, ChangeSet>> before;
  if (!same_ids) {
    before.emplace(objects_, changes_);
    before->first.reserve(capacity_);
    before->second.reserve(capacity_);
  }
  const std::size_t mapped = std::exchange(mapped_, 0);
  swap_boxes();
  const auto restore = [&] {
    swap_boxes();
    spare_slots_ = std::max(spare_slots_, n);
    mapped_ = mapped;
    if (before) std::tie(objects_, changes_) = std::move(*before);
    changes_.all = changes_.all_filters = true;
  };
  try {
    copy_all(view);
    end();
    spare_slots_ = slots;
  } catch (const InvalidBox& box) {
    restore();
    throw_nan("box " + std::to_string(box.index));
  } catch (...) {
    restore();
    throw;
  }
}

std::vector<std::uint32_t> Core::add(const BoxView& boxes, std::span<const Filter> filters) {
  refuse_forked();
  refuse_addition(boxes.size(), filters.size());
  std::vector<Aabb> packed(boxes.size());
  boxes.pack_to(packed);
  const bool any_filters = std::ranges::any_of(filters, [](const Filter& f) { return f != Filter(); });
  std::vector<std::uint32_t> ids(packed.size());
  // (Perhaps some have free ids.)
  const std::size_t free = objects_.ids() - objects_.size();
  reserve(objects_.ids() + packed.size() - std::min(free, packed.size()), any_filters);
  reserve_late(packed.size());
  // Nothing below throws.
  any_empty_ = any_empty_ || std::ranges::any_of(packed, has_nan);
  for (std::size_t k = 0; k < packed.size(); ++k) {
    ids[k] = add_packed(packed[k], filters[filters.size() == 1 ? 0 : k]);
  }
  return ids;
}

void Core::move(std::span<const std::uint32_t> ids, const BoxView& boxes) {
  refuse_forked();
  refuse_moves(ids.size(), boxes.size());
  BoxMoves moves(ids, boxes, objects_, threads_);
  reserve_late(ids.size());
  // Nothing below throws.
  any_empty_ = any_empty_ || moves.any_empty();
  if (is_late() || mapped_ > 0) {
    return moves.for_each([&](std::uint32_t id, const Aabb& packed) { set_box(id, packed); });
  }
  moves.store(boxes_);
  if (moves.changed_count() > objects_.slots() / 4) {
    changes_.all = true;
  } else {
    moves.for_each_changed([&](std::uint32_t id) { changes_.insert(id); });
  }
}

void Core::set_filter(std::uint32_t id, const Filter& filter) {
  objects_.refuse_unknown(id);
  reserve(objects_.ids(), filter != Filter());
  // Nothing below throws.
  store_filter(id, filter);
}

void Core::set_exclusions(std::span<const Pair> pairs) {
  std::vector<Pair> sorted = sorted_exclusions(pairs);
  const std::vector<Pair> changed = symmetric_difference(exclusions_, sorted);
  // Nothing below throws.
  exclusions_ = std::move(sorted);
  for (const Pair& pair : changed) {
    if (!objects_.contains(pair.a) || !objects_.contains(pair.b)) continue;
    changes_.insert(pair.a);
    changes_.insert(pair.b);
  }
  changes_.exclusions = changes_.exclusions || !changed.empty();
}

void Core::remove(std::span<const std::uint32_t> ids) {
  refuse_forked();
  for (const std::uint32_t id : ids) objects_.refuse_unknown(id);
  refuse_twice(ids);
  reserve_late(ids.size());
  // Nothing below throws.
  for (const std::uint32_t id : ids) {
    objects_.remove(id);
    changes_.recycle(id);
    set_box(id, packed_empty());
  }
}

Aabb Core::box(std::uint32_t id) const {
  refuse_forked();
  objects_.refuse_unknown(id);
  const Aabb* const late = late_.find(id);
  const Aabb& box = late != nullptr ? *late : boxes_[id];
  return id >= mapped_ && has_nan(box) ? empty_aabb() : box;
}

const Filter& Core::filter(std::uint32_t id) const {
  objects_.refuse_unknown(id);
  return objects_.filter(id);
}

/// Replaces all boxes that are not proper.
void Core::replace_empty(std::span<Aabb> boxes, const Aabb& by) const noexcept {
  for_each_part(boxes.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    for (Aabb& box : boxes.subspan(begin, end - begin)) {
      if (!is_proper(box)) box = by;
    }
  });
}

std::span<Aabb> Core::map(std::size_t n) {
  const std::size_t own = mapped_;  // boxes that the caller has written before
  const std::span<Aabb> boxes = remap(n, n, empty_aabb());
  if (n > own && any_empty_) {  // the caller must not get an error for a NaN that somebody else wrote
    replace_empty(boxes.subspan(own), empty_aabb());
    any_empty_ = false;
  }
  return boxes;
}

std::span<Aabb> Core::map_packed(std::size_t n) {
  any_empty_ = true;
  return remap(n, 0, packed_empty());
}

void Core::begin(const BoxView& boxes) {
  replace_all(boxes, [&] { flush(); });
}

Delta Core::update(const BoxView& boxes) {
  Delta delta;
  replace_all(boxes, [&] { delta = finish(); });
  return delta;
}

void Core::begin(BoxReplacement* arriving, const LookAtBoxes* look) {
  refuse_forked();
  if (is_begun()) return;
  apply_late();
  flight_.reserve(capacity_);  // here, since an update in flight reads it
  or_find_boxes([&] { algorithm_->reserve_exclusions(exclusions_.size()); });
  take_mapped(look);
  update_ = Update::begun;
  if (changes_.empty()) return;
  std::swap(flight_, changes_);
  flight_.sort_recycled();
  update_ = Update::in_flight;
  or_roll_back([&] {
    const std::size_t slots = objects_.slots();
    const bool are_two_sets = objects_.any_filters() && objects_.sets().are_apart();
    // If many boxes changed, testing all pairs once is less work than testing the changed boxes against all.
    const bool all = flight_.all || flight_.changed().size() > slots / 4;
    algorithm_->begin({.boxes = algorithm_->boxes().first(slots),
                       .arriving = arriving,
                       .changed = {.all = all, .slots = flight_.changed(), .recycled = flight_.recycled()},
                       .rules = {.filters = objects_.filters(),
                                 .exclusions = exclusions_,
                                 .all_changed = flight_.all_filters,
                                 .refiltered = flight_.refiltered(),
                                 .filters_changed = flight_.filters,
                                 .exclusions_changed = flight_.exclusions,
                                 .worlds = objects_.any_worlds(),
                                 .sets = are_two_sets,
                                 .sets_decide = are_two_sets && objects_.sets().decide()},
                       .listener = listener_});
  });
}

void Core::flush() {
  if (is_in_flight()) or_roll_back([&] { algorithm_->flush(); });
}

Delta Core::finish() {
  begin();
  Delta delta;
  if (is_in_flight()) or_roll_back([&] { delta = algorithm_->finish(); });
  boxes_ = algorithm_->boxes();
  flight_.clear();
  update_ = is_in_flight() ? Update::done : Update::none;
  // If there is no memory yet for objects that were added during the update, the next update allocates it.
  if (has_memory_for(objects_.ids(), objects_.any_filters())) apply_late();
  return delta;
}

void Core::shrink() {
  if (is_begun()) throw Error("shrink() was called between begin() and finish(); call finish() first");
  refuse_forked();
  apply_late();
  std::size_t ids = objects_.slots();  // higher ones that are free need not be stored
  for (const std::uint32_t changed : changes_.changed()) ids = std::max<std::size_t>(ids, changed + 1);
  ChangeSet changes;
  changes.reserve(ids);
  changes.insert(changes_);
  ObjectTable objects = objects_.shrunk(ids);
  has_filter_memory_ = false;  // even if a part of the following fails
  or_find_boxes([&] { algorithm_->shrink(ids); });
  // Nothing below throws, until all is done.
  boxes_ = algorithm_->boxes();
  objects_ = std::move(objects);
  changes_ = std::move(changes);
  flight_ = {};
  late_.shrink();
  capacity_ = ids;
  update_ = Update::none;
  exclusions_.shrink_to_fit();
  reserve_algorithm(ids, objects_.any_filters());
}

std::vector<Pair> Core::pairs() const {
  refuse_forked();
  if (is_begun()) throw Error("pairs() was called between begin() and finish(); call finish() first");
  return algorithm_->pairs();
}

void Core::reserve(std::size_t ids, bool filters) {
  if (ids > most_objects) throw_too_many(ids);
  if (ids > capacity_) {
    const std::size_t capacity = std::max({ids, capacity_ + capacity_ / 2, least_capacity});
    objects_.reserve(capacity);
    changes_.reserve(capacity);
    capacity_ = capacity;
  }
  if (!is_in_flight()) reserve_algorithm(ids, filters || objects_.any_filters());
}

void Core::reserve_algorithm(std::size_t ids, bool filters) {
  if (has_memory_for(ids, filters)) return;
  or_find_boxes([&] { algorithm_->reserve(ids, filters || has_filter_memory_); });
  boxes_ = algorithm_->boxes();
  has_filter_memory_ = has_filter_memory_ || filters;
}

void Core::apply_late() {
  reserve_algorithm(objects_.ids(), objects_.any_filters());
  // Nothing below throws.
  for (const auto& [id, box] : late_) store_box(id, box);
  late_.clear();
}

void Core::refuse_replacement(std::size_t boxes) const {
  refuse_forked();
  if (is_begun()) throw Error("boxes cannot be replaced between begin() and finish(); call finish() first");
  if (boxes > most_objects) throw_too_many(boxes);
}

void Core::refuse_addition(std::size_t boxes, std::size_t filters) {
  if (filters != 1 && filters != boxes) {
    throw Error::invalid_argument(std::to_string(filters) + " filters for " + std::to_string(boxes) +
                                  " boxes; give one for all, or one for each");
  }
  if (boxes > most_objects) throw_too_many(boxes);
}

void Core::refuse_moves(std::size_t ids, std::size_t boxes) {
  if (ids != boxes) {
    throw Error::invalid_argument(std::to_string(ids) + " ids and " + std::to_string(boxes) +
                                  " boxes; give as many of both");
  }
}

void Core::reserve_all(std::size_t n) {
  refuse_replacement(n);
  apply_late();
  reserve(std::max(n, objects_.ids()), false);
}

std::span<Aabb> Core::remap(std::size_t n, std::size_t mapped, const Aabb& empty) {
  reserve_all(n);
  // Nothing below throws.
  mapped_ = mapped;
  set_ids(n, empty, [&](std::uint32_t id, const Aabb& box) { boxes_[id] = box; });
  changes_.all = true;
  return boxes_.first(n);
}

void Core::swap_boxes() noexcept {
  algorithm_->swap_boxes();
  boxes_ = algorithm_->boxes();
}

void Core::copy_all(const BoxView& view) {
  const std::size_t n = view.size();
  const bool uploads = algorithm_->uploads_boxes();
  constexpr std::size_t most_cached = std::size_t{1} << 18U;
  const bool streams = uploads || n > most_cached;
  // An upload of all boxes can begin before it is known which changed.
  const bool arrive_later = uploads && many_moved_;
  BoxReplacement replacement(view, algorithm_->spare_boxes(), boxes_, streams, arrive_later, threads_);
  if (!arrive_later) replacement.finish();
  for (std::size_t id = n; id < std::min(spare_slots_, boxes_.size()); ++id) boxes_[id] = packed_empty();
  set_ids(n, packed_empty(), [](std::uint32_t /*id*/, const Aabb& /*box*/) {});
  if (arrive_later || replacement.count() > n / 4) {
    changes_.all = true;
  } else {
    replacement.for_each_changed([&](std::uint32_t slot) { changes_.insert(slot); });
  }
  begin(arrive_later ? &replacement : nullptr, nullptr);
  many_moved_ = replacement.count() > n / 4;
  any_empty_ = any_empty_ || replacement.any_empty();
}

void Core::take_mapped(const LookAtBoxes* look) {
  const std::span<Aabb> boxes = boxes_.first(mapped_);
  std::atomic<bool> any_empty = false;
  LowestFound nan(boxes.size());
  for_each_part(boxes.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    for (std::size_t id = begin; id < end; ++id) {
      if (is_proper(boxes[id])) continue;
      any_empty = true;
      if (has_nan(boxes[id])) return nan.add(id);
    }
    if (look != nullptr) (*look)(begin, end, boxes);
  });
  if (nan.any()) throw_nan("box " + std::to_string(nan.get()));
  // Nothing below throws.
  if (any_empty) {
    any_empty_ = true;
    replace_empty(boxes, packed_empty());
  }
  mapped_ = 0;
}

void Core::throw_too_many(std::size_t objects) {
  throw Error::invalid_argument(std::to_string(objects) + " objects are too many; use at most " +
                                std::to_string(most_objects));
}

void Core::refuse_twice(std::span<const std::uint32_t> ids) {
  if (ids.size() < 2) return;
  std::vector<std::uint32_t> sorted(ids.begin(), ids.end());
  std::ranges::sort(sorted);
  const auto twice = std::ranges::adjacent_find(sorted);
  if (twice != sorted.end()) {
    throw Error::invalid_argument("the id " + std::to_string(*twice) + " is given twice; give each once");
  }
}

}  // namespace broadcl
