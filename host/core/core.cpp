#include "core/core.hpp"

#include <atomic>
#include <string>

#include <broadcl/error.hpp>

#include "base/box_parts.hpp"
#include "base/packed_boxes.hpp"
#include "base/pair_lists.hpp"
#include "core/box_moves.hpp"
#include "core/exclusions.hpp"
#include "core/reach.hpp"

namespace broadcl {
namespace {

[[noreturn]] void throw_has_distance() {
  throw Error::invalid_argument("objects have the reaches that Config::distance gives them; set that to 0");
}

template <class Bound>
bool any_above_0(std::span<const Bound> reaches) {
  return std::ranges::any_of(reaches, [](Bound reach) { return reach > 0; });
}

bool any_not_default(std::span<const Filter> filters) {
  return std::ranges::any_of(filters, [](const Filter& filter) { return filter != Filter(); });
}

/// @param what The plural of what is given for each of the objects, or once for all.
void refuse_other_number(std::size_t given, const char* what, std::size_t objects) {
  if (given == 1 || given == objects) return;
  throw Error::invalid_argument(std::to_string(given) + " " + what + " for " + std::to_string(objects) +
                                " objects; give one for all, or one for each");
}

void refuse_twice(std::span<const std::uint32_t> ids) {
  if (ids.size() < 2) return;
  std::vector<std::uint32_t> sorted(ids.begin(), ids.end());
  std::ranges::sort(sorted);
  const auto twice = std::ranges::adjacent_find(sorted);
  if (twice != sorted.end()) {
    throw Error::invalid_argument("the id " + std::to_string(*twice) + " is given twice; give each once");
  }
}

}  // namespace

template <class Box>
template <class Function>
void Core<Box>::or_roll_back(const Function& function) {
  try {
    function();
  } catch (...) {
    boxes_ = find_boxes();
    update_ = Update::none;
    changes_.insert(flight_);
    changes_.all = changes_.all_filters = true;
    flight_.clear();
    forget_unread();
    throw;
  }
}

template <class Box>
std::span<Box> Core<Box>::find_boxes() noexcept {
  if constexpr (is_exact) {
    const std::span<Box> boxes = exact_.boxes.get();
    return boxes.first(std::min(boxes.size(), algorithm_->boxes().size()));
  } else {
    return algorithm_->boxes();
  }
}

template <class Box>
std::vector<std::uint32_t> Core<Box>::add(const BoxView& boxes, std::span<const Filter> filters,
                                          std::span<const Bound> reaches) {
  refuse_forked();
  refuse_other_number(filters.size(), "filters", boxes.size());
  constexpr Bound none = 0;
  if (reaches.empty()) reaches = {&none, 1};
  refuse_reaches(reaches, boxes.size());
  refuse_too_many_objects(boxes.size());
  const std::vector<Box> packed = packed_boxes<Box>(boxes, threads_);
  std::vector<std::uint32_t> ids(packed.size());
  // (Perhaps some have free ids.)
  const std::size_t free = objects_.ids() - objects_.size();
  reserve(objects_.ids() + packed.size() - std::min(free, packed.size()), any_not_default(filters),
          any_above_0(reaches));
  reserve_late(packed.size());
  // Nothing below throws.
  any_empty_ = any_empty_ || std::ranges::any_of(packed, [](const Box& box) { return has_nan(box); });
  for (std::size_t k = 0; k < packed.size(); ++k) {
    ids[k] =
        add_packed(packed[k], filters[filters.size() == 1 ? 0 : k], reaches[reaches.size() == 1 ? 0 : k]);
  }
  return ids;
}

template <class Box>
void Core<Box>::move(std::span<const std::uint32_t> ids, const BoxView& boxes) {
  refuse_forked();
  if (ids.size() != boxes.size()) {
    throw Error::invalid_argument(std::to_string(ids.size()) + " ids and " + std::to_string(boxes.size()) +
                                  " boxes; give as many of both");
  }
  BoxMoves<Box> moves(ids, boxes, objects_, threads_);
  reserve_late(ids.size());
  // Nothing below throws.
  any_empty_ = any_empty_ || moves.any_empty();
  if (is_late() || mapped_ > 0) {
    return moves.for_each([&](std::uint32_t id, const Box& packed) { set_box(id, packed); });
  }
  moves.store(boxes_);
  if (moves.changed_count() > objects_.slots() / 4) {
    changes_.all = true;
  } else {
    moves.for_each_changed([&](std::uint32_t id) { changes_.insert(id); });
  }
}

template <class Box>
void Core<Box>::set_filters(std::span<const std::uint32_t> ids, std::span<const Filter> filters) {
  for (const std::uint32_t id : ids) objects_.refuse_unknown(id);
  refuse_other_number(filters.size(), "filters", ids.size());
  reserve(objects_.ids(), any_not_default(filters));
  // Nothing below throws.
  for (std::size_t k = 0; k < ids.size(); ++k) store_filter(ids[k], filters[filters.size() == 1 ? 0 : k]);
}

template <class Box>
void Core<Box>::refuse_reaches(std::span<const Bound> reaches, std::size_t objects) const {
  refuse_other_number(reaches.size(), "reaches", objects);
  for (const Bound reach : reaches) {
    refuse_invalid_reach(reach);
    if (reach > 0 && objects_.first_reach() > 0) throw_has_distance();
  }
}

template <class Box>
void Core<Box>::set_reach(std::span<const std::uint32_t> ids, std::span<const Bound> reaches) {
  if (objects_.first_reach() > 0) throw_has_distance();
  for (const std::uint32_t id : ids) objects_.refuse_unknown(id);
  refuse_reaches(reaches, ids.size());
  reserve(objects_.ids(), false, any_above_0(reaches));
  // Nothing below throws.
  for (std::size_t k = 0; k < ids.size(); ++k) store_reach(ids[k], reaches[reaches.size() == 1 ? 0 : k]);
}

template <class Box>
void Core<Box>::set_exclusions(std::span<const Pair> pairs) {
  std::vector<Pair> sorted = sorted_exclusions(pairs);
  sorted.shrink_to_fit();
  share_exclusions(std::make_shared<const std::vector<Pair>>(std::move(sorted)));
}

template <class Box>
void Core<Box>::share_exclusions(const SharedPairs& pairs) {
  const std::vector<Pair> changed = symmetric_difference(*exclusions_, *pairs);
  // Nothing below throws.
  exclusions_ = pairs;
  for (const Pair& pair : changed) {
    if (!objects_.contains(pair.a) || !objects_.contains(pair.b)) continue;
    changes_.insert(pair.a);
    changes_.insert(pair.b);
  }
  changes_.exclusions = changes_.exclusions || !changed.empty();
}

template <class Box>
void Core<Box>::remove(std::span<const std::uint32_t> ids) {
  refuse_forked();
  for (const std::uint32_t id : ids) objects_.refuse_unknown(id);
  refuse_twice(ids);
  reserve_late(ids.size());
  // Nothing below throws.
  for (const std::uint32_t id : ids) {
    objects_.remove(id);
    changes_.recycle(id);
    set_box(id, packed_empty_box);
  }
}

template <class Box>
Box Core<Box>::box(std::uint32_t id) const {
  refuse_forked();
  objects_.refuse_unknown(id);
  const Box* const late = late_.find(id);
  const Box& box = late != nullptr ? *late : boxes_[id];
  return id >= mapped_ && has_nan(box) ? empty_box : box;
}

template <class Box>
const Filter& Core<Box>::filter(std::uint32_t id) const {
  objects_.refuse_unknown(id);
  return objects_.filter(id);
}

template <class Box>
auto Core<Box>::reach(std::uint32_t id) const -> Bound {
  objects_.refuse_unknown(id);
  return objects_.reach(id);
}

template <class Box>
std::vector<std::uint32_t> Core<Box>::ids() const {
  std::vector<std::uint32_t> ids;
  ids.reserve(objects_.size());
  for (std::uint32_t id = 0; ids.size() < objects_.size(); ++id) {
    if (objects_.contains(id)) ids.push_back(id);
  }
  return ids;
}

/// Replaces all boxes that are not proper.
template <class Box>
void Core<Box>::replace_empty(std::span<Box> boxes, const Box& by) const noexcept {
  for_each_part(boxes.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    for (Box& box : boxes.subspan(begin, end - begin)) {
      if (!is_proper(box)) box = by;
    }
  });
}

template <class Box>
std::shared_ptr<const void> Core<Box>::boxes_owner() const {
  if constexpr (is_exact) {
    return exact_.boxes.owner();
  } else {
    return algorithm_->boxes_owner();
  }
}

/// Makes what changed known to the algorithm's boxes.
template <class Box>
void Core<Box>::convert_changed(bool are_converted) {
  if constexpr (is_exact) {
    if (!are_converted && objects_.any_reaches()) exact_.converted.keep_distances(changes_);
    if (!are_converted && !changes_.empty())
      exact_.converted.convert(boxes_.first(objects_.ids()), algorithm_->boxes(), changes_);
    exact_.reaches.update(objects_.reaches(), algorithm_->boxes(), changes_);
  }
}

/// Those of the objects, without what changed.
template <class Box>
PairRules Core<Box>::rules() const {
  const bool are_two_sets = objects_.any_filters() && objects_.sets().are_apart();
  return {.filters = objects_.filters(),
          .reaches = reaches_of_images(),
          .worlds = objects_.any_worlds(),
          .sets = are_two_sets,
          .sets_decide = are_two_sets && objects_.sets().decide()};
}

template <class Box>
void Core<Box>::begin(ArrivingBoxes* arriving, const LookAtBoxes<Box>* look, bool are_converted) {
  refuse_forked();
  if (is_begun()) return;
  apply_late();
  flight_.reserve(capacity_);  // here, since an update in flight reads it
  if (own_tree_ || !read_.empty()) unread_.reserve(capacity_);
  timeline_.reserve(capacity_);
  or_find_boxes([&] { algorithm_->reserve_exclusions(exclusions_->size()); });
  if constexpr (is_exact) exact_.pairs.begin(*algorithm_);
  take_mapped(look);
  convert_changed(are_converted);
  if (arriving == nullptr) record();
  update_ = Update::begun;
  if (changes_.empty() && read_.empty()) return;
  if (own_tree_ || !read_.empty()) unread_.insert(changes_);
  if (!read_.empty() && !own_tree_) unread_slots_ = {.all = unread_.all, .slots = unread_.changed()};
  std::swap(flight_, changes_);
  flight_.insert(read_);
  read_.clear();
  flight_.sort_recycled();
  timeline_.record(flight_);
  update_ = Update::in_flight;
  or_roll_back([&] {
    const std::size_t slots = objects_.slots();
    PairRules rules = this->rules();
    rules.exclusions = *exclusions_;
    rules.all_changed = flight_.all_filters;
    if (!rules.filters.empty()) rules.refiltered = flight_.refiltered();
    rules.filters_changed = flight_.filters;
    rules.exclusions_changed = flight_.exclusions;
    // If many boxes changed, testing all pairs once is less work than testing the changed boxes against all.
    const bool all = flight_.all || flight_.changed().size() > slots / 4;
    algorithm_->begin({.boxes = algorithm_->boxes().first(slots),
                       .arriving = arriving,
                       .changed = {.all = all, .slots = flight_.changed(), .recycled = flight_.recycled()},
                       .unread = unread_slots_ ? &*unread_slots_ : nullptr,
                       .rules = rules});
  });
}

template <class Box>
void Core<Box>::flush() {
  if (is_in_flight()) or_roll_back([&] { algorithm_->flush(); });
}

template <class Box>
Delta Core<Box>::finish() {
  begin();
  Delta delta;
  if (is_in_flight()) {
    or_roll_back([&] {
      delta = algorithm_->finish();
      if constexpr (is_exact) {
        const SlotChanges changed{.slots = flight_.changed(), .recycled = flight_.recycled()};
        delta = exact_.pairs.finish(*algorithm_, delta, changed, exact_.converted.in_doubt(), boxes_,
                                    exact_.reaches.exact());
        exact_.converted.count_apart(exact_.pairs.apart(), objects_.size());
      }
    });
  }
  boxes_ = find_boxes();
  flight_.clear();
  forget_unread();
  update_ = is_in_flight() ? Update::done : Update::none;
  // If there is no memory yet for objects that were added during the update, the next update allocates it.
  if (has_memory_for(objects_.ids(), objects_.any_filters())) apply_late();
  return delta;
}

template <class Box>
void Core<Box>::shrink() {
  if (is_begun()) throw Error("shrink() was called between begin() and finish(); call finish() first");
  refuse_forked();
  apply_late();
  changes_.insert(read_);
  read_ = unread_ = {};
  own_tree_.reset();
  std::size_t ids = objects_.slots();  // higher ones that are free need not be stored
  for (const std::uint32_t changed : changes_.changed()) ids = std::max<std::size_t>(ids, changed + 1);
  ChangeSet changes;
  changes.reserve(ids);
  changes.insert(changes_);
  ObjectTable objects = objects_.shrunk(ids);
  has_filter_memory_ = false;  // even if a part of the following fails
  or_find_boxes([&] {
    if constexpr (is_exact) {
      exact_.pairs.shrink();
      exact_.boxes.shrink(ids);
      exact_.reaches.shrink(ids);
    }
    algorithm_->shrink(ids);
  });
  // Nothing below throws, until all is done.
  boxes_ = find_boxes();
  objects_ = std::move(objects);
  changes_ = std::move(changes);
  flight_ = {};
  timeline_ = {};
  late_.shrink();
  capacity_ = ids;
  update_ = Update::none;
  reserve_algorithm(ids, objects_.any_filters());
}

template <class Box>
std::vector<Pair> Core<Box>::pairs() const {
  refuse_forked();
  if (is_begun()) throw Error("pairs() was called between begin() and finish(); call finish() first");
  if constexpr (is_exact) {
    return exact_.pairs.all(*algorithm_);
  } else {
    return algorithm_->pairs();
  }
}

template <class Box>
void Core<Box>::reserve(std::size_t ids, bool filters, bool reaches) {
  refuse_too_many_objects(ids);
  if (ids > capacity_) {
    const std::size_t capacity = std::max({ids, capacity_ + capacity_ / 2, least_capacity});
    objects_.reserve(capacity);
    changes_.reserve(capacity);
    capacity_ = capacity;
  }
  if (reaches) objects_.reserve_reaches();
  if (!is_in_flight()) reserve_algorithm(ids, filters || objects_.any_filters());
}

template <class Box>
void Core<Box>::reserve_algorithm(std::size_t ids, bool filters) {
  if (has_memory_for(ids, filters)) return;
  or_find_boxes([&] {
    if constexpr (is_exact) exact_.boxes.reserve(ids);
    algorithm_->reserve(ids, filters || has_filter_memory_);
  });
  boxes_ = find_boxes();
  has_filter_memory_ = has_filter_memory_ || filters;
}

template <class Box>
void Core<Box>::apply_late() {
  reserve_algorithm(objects_.ids(), objects_.any_filters());
  // Nothing below throws.
  for (const auto& [id, box] : late_) store_box(id, box);
  late_.clear();
}

template <class Box>
void Core<Box>::take_mapped(const LookAtBoxes<Box>* look) {
  const std::span<Box> boxes = boxes_.first(mapped_);
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
    replace_empty(boxes, packed_empty_box);
  }
  mapped_ = 0;
}

template class Core<Aabb>;
template class Core<Aabb64>;

}  // namespace broadcl
