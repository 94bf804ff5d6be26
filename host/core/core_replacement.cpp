#include <algorithm>
#include <cstring>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <broadcl/error.hpp>

#include "base/box_reader.hpp"
#include "base/box_replacement.hpp"
#include "core/core.hpp"

/// How the boxes of all objects are replaced at once: by the caller's, which may be in place, or by those of
/// a saved state.
namespace broadcl {

template <class Box>
template <class SetBox>
void Core<Box>::set_ids(std::size_t n, const Box& empty, const SetBox& set) noexcept {
  if (objects_.size() == n && objects_.slots() == n) return;
  const auto all = [](std::uint32_t /*id*/) { return true; };
  objects_.set_ids(std::min<std::size_t>(n, objects_.next()), n, all, [&](std::uint32_t id) {
    const bool is_new = objects_.contains(id);
    set(id, is_new ? empty : packed_empty_box);
    changes_.recycle(id);
    if (!is_new) return;
    store_filter(id, Filter());
    store_reach(id, objects_.first_reach());
  });
}

/// Whether ids, filters, reaches and exclusions are those that were saved, and no id was given to another
/// object since the last update.
template <class Box>
bool Core<Box>::has_objects(const Saved<Box>& saved) noexcept {
  const auto is_same = [slots = objects_.slots()](auto present, const auto& other) {
    present = present.first(std::min(slots, present.size()));
    return present.size() == other.size() &&
           (other.empty() || std::memcmp(present.data(), other.data(), present.size_bytes()) == 0);
  };
  return changes_.recycled().empty() && read_.recycled().empty() && is_same(objects_.live(), saved.live) &&
         is_same(objects_.filters(), saved.filters) &&
         (objects_.first_reach() > 0 || is_same(objects_.reaches(), saved.reaches)) &&
         (exclusions_ == saved.exclusions || *exclusions_ == *saved.exclusions);
}

/// Makes ids, filters, reaches and exclusions those that were saved. The memory must be reserved. Pairs that
/// are there before and afterwards are to be the same pairs, so no slot counts as recycled.
template <class Box>
void Core<Box>::set_objects(const Saved<Box>& saved) {
  changes_.forget_recycled();
  read_.forget_recycled();
  objects_.set_ids(
      0, saved.live.size(), [&](std::uint32_t id) { return saved.live[id] != 0; },
      [&](std::uint32_t id) { changes_.refilter(id); });
  for (std::uint32_t id = 0; id < saved.live.size(); ++id) {
    if (saved.live[id] == 0) continue;
    store_filter(id, saved.filters.empty() ? Filter() : saved.filters[id]);
    store_reach(id, saved.reaches.empty() ? objects_.first_reach() : saved.reaches[id]);
  }
  share_exclusions(saved.exclusions);
}

template <class Box>
std::span<Box> Core<Box>::find_spare() {
  if constexpr (is_exact) {
    (void)algorithm_->spare_boxes();
    return exact_.boxes.spare();
  } else {
    return algorithm_->spare_boxes();
  }
}

template <class Box>
template <class Function>
void Core<Box>::replace_all(const BoxView& view, const Saved<Box>* saved, const Function& end) {
  reserve_all(view.size());
  const std::size_t slots = objects_.slots();
  const bool same_objects =
      saved != nullptr ? has_objects(*saved) : objects_.size() == view.size() && slots == view.size();
  try {
    if (same_objects && mapped_ == 0 && replace_few(view, saved, end)) return;
    try {
      replace_many(view, saved, same_objects, end);
    } catch (const OutgrownMap&) {
      if constexpr (is_exact) {
        exact_.converted.renew(view);
        replace_many(view, saved, same_objects, end);
      }
    }
  } catch (const InvalidBox& box) {
    throw_nan("box " + std::to_string(box.index));
  }
}

template <class Box>
std::optional<std::vector<std::uint32_t>> Core<Box>::changed_since(const Saved<Box>& saved) {
  timeline_.reserve(capacity_);
  timeline_.record(changes_);
  timeline_.record(read_);
  const auto changed = timeline_.since(saved.moment);
  if (!changed) return std::nullopt;
  std::vector<std::uint32_t> slots;
  for_each_bit(*changed, [&](std::uint32_t slot) {
    if (slot < saved.boxes.size()) slots.push_back(slot);
  });
  if (slots.size() > saved.boxes.size() / 4) return std::nullopt;
  return slots;
}

template <class Box>
template <class Function>
bool Core<Box>::replace_few(const BoxView& view, const Saved<Box>* saved, const Function& end) {
  std::vector<std::pair<std::uint32_t, Box>> others;
  BoxReader<Box> reader(view);
  const auto compare = [&](std::uint32_t slot) {
    const Box box = pack(reader.read(slot, slot + 1).front());
    if (same_bits(boxes_[slot], box)) return;
    others.emplace_back(slot, box);
    any_empty_ = any_empty_ || !is_proper(box);
  };
  if (const auto slots = saved != nullptr ? changed_since(*saved) : std::nullopt) {
    std::ranges::for_each(*slots, compare);
    many_moved_ = false;
  } else {
    if (many_moved_) return false;
    BoxReplacement<Box> comparison(view, boxes_, {}, false, false, threads_);
    comparison.finish();
    many_moved_ = comparison.are_many();
    if (many_moved_) return false;
    comparison.for_each_changed(compare);
  }
  const auto swap_boxes = [&] {
    for (auto& [slot, box] : others) std::swap(boxes_[slot], box);
  };
  swap_boxes();
  for (const auto& [slot, box] : others) changes_.insert(slot);
  try {
    begin();
    end();
  } catch (...) {
    swap_boxes();
    throw;
  }
  return true;
}

template <class Box>
template <class Function>
void Core<Box>::replace_many(const BoxView& view, const Saved<Box>* saved, bool same_objects,
                             const Function& end) {
  const std::size_t n = view.size();
  or_find_boxes([&] {
    (void)find_spare();
    const std::size_t exclusions = (saved != nullptr ? saved->exclusions : exclusions_)->size();
    algorithm_->reserve_exclusions(exclusions);  // which may move boxes, before they are written
  });
  const std::size_t slots = objects_.slots();
  std::optional<std::tuple<ObjectTable<Bound>, ChangeSet, SharedPairs>> before;
  if (!same_objects) {
    before.emplace(objects_, changes_, exclusions_);
    auto& [objects, changes, exclusions] = *before;
    objects.reserve(capacity_);
    changes.reserve(capacity_);
    changes.insert(read_);
  }
  const std::size_t mapped = std::exchange(mapped_, 0);
  swap_boxes();
  const auto restore = [&] {
    swap_boxes();
    spare_slots_ = std::max(spare_slots_, n);
    mapped_ = mapped;
    if (before) std::tie(objects_, changes_, exclusions_) = std::move(*before);
    changes_.all = changes_.all_filters = true;
  };
  try {
    if (saved != nullptr && !same_objects) set_objects(*saved);
    copy_all(view, saved == nullptr);
    end();
    spare_slots_ = std::max(slots, mapped);
  } catch (...) {
    restore();
    throw;
  }
}

template <class Box>
std::span<Box> Core<Box>::map(std::size_t n) {
  reserve_all(n);
  // Nothing below throws.
  const std::size_t own = std::exchange(mapped_, n);  // boxes that the caller has written before
  set_ids(n, empty_box, [&](std::uint32_t id, const Box& box) { boxes_[id] = box; });
  changes_.all = true;
  const std::span<Box> boxes = boxes_.first(n);
  if (n < own) std::ranges::fill(boxes_.first(own).subspan(n), packed_empty_box);
  if (n > own && any_empty_) {  // the caller must not get an error for a NaN that somebody else wrote
    replace_empty(boxes.subspan(own), empty_box);
    any_empty_ = false;
  }
  return boxes;
}

template <class Box>
void Core<Box>::begin(const BoxView& boxes) {
  replace_all(boxes, nullptr, [&] { flush(); });
}

template <class Box>
Delta Core<Box>::update(const BoxView& boxes) {
  Delta delta;
  replace_all(boxes, nullptr, [&] { delta = finish(); });
  return delta;
}

template <class Box>
std::shared_ptr<const Saved<Box>> Core<Box>::save() {
  refuse_forked();
  if (is_begun()) throw Error("save() was called between begin() and finish(); call finish() first");
  if (!changes_.empty() || !read_.empty() || !late_.empty())
    throw Error("save() was called with changes that no update has reported; call update() first");
  const std::size_t slots = objects_.slots();
  const auto copy_of = [&](auto all) {
    all = all.first(std::min(slots, all.size()));
    return std::vector(all.begin(), all.end());
  };
  const bool has_distance = objects_.first_reach() > 0;
  auto saved = std::make_shared<Saved<Box>>(
      Saved<Box>{.boxes = copy_of(boxes_),
                 .live = copy_of(objects_.live()),
                 .filters = copy_of(objects_.filters()),
                 .reaches = has_distance ? std::vector<Bound>() : copy_of(objects_.reaches()),
                 .exclusions = exclusions_,
                 .first_reach = objects_.first_reach(),
                 .moment = timeline_.now(capacity_)});
  if (any_empty_ || objects_.size() < slots) replace_empty(saved->boxes, empty_box);
  return saved;
}

template <class Box>
Delta Core<Box>::restore(const Saved<Box>& saved) {
  refuse_replacement(saved.live.size());
  if (saved.first_reach != objects_.first_reach()) {
    throw Error::invalid_argument(
        "the state is of an object with another Config::distance; restore it in one with the same");
  }
  reserve(std::max(saved.live.size(), objects_.ids()), !saved.filters.empty(), !saved.reaches.empty());
  Delta delta;
  replace_all(BoxView(saved.boxes), &saved, [&] { delta = finish(); });
  return delta;
}

template <class Box>
void Core<Box>::refuse_replacement(std::size_t boxes) const {
  refuse_forked();
  if (is_begun()) throw Error("boxes cannot be replaced between begin() and finish(); call finish() first");
  refuse_too_many_objects(boxes);
}

template <class Box>
void Core<Box>::reserve_all(std::size_t n) {
  refuse_replacement(n);
  apply_late();
  reserve(std::max(n, objects_.ids()), false);
}

template <class Box>
void Core<Box>::swap_boxes() noexcept {
  algorithm_->swap_boxes();
  if constexpr (is_exact) exact_.boxes.swap();
  boxes_ = find_boxes();
}

template <class Box>
void Core<Box>::copy_all(const BoxView& view, bool sets_ids) {
  const std::size_t n = view.size();
  const bool uploads = algorithm_->uploads_boxes();
  constexpr std::size_t most_cached = std::size_t{1} << 18U;
  const bool streams = uploads || n > most_cached;
  // An upload of all boxes can begin before it is known which changed.
  // (Reaches of images depend on the images.)
  const bool arrive_later = uploads && many_moved_ && !(is_exact && objects_.any_reaches());
  Conversion* conversion = nullptr;
  if constexpr (is_exact) {
    if (objects_.any_reaches()) exact_.converted.keep_distances(changes_);
    conversion = &exact_.converted.begin(view, find_spare().first(objects_.ids()), algorithm_->boxes(),
                                         changes_, arrive_later);
  }
  BoxReplacement<Box> replacement(view, find_spare(), boxes_, streams, arrive_later, threads_, conversion);
  if (!arrive_later) replacement.finish();
  for (std::size_t id = n; id < std::min(spare_slots_, boxes_.size()); ++id) {
    boxes_[id] = packed_empty_box;
    if constexpr (is_exact) algorithm_->boxes()[id] = packed_empty();
  }
  if (sets_ids) set_ids(n, packed_empty_box, [](std::uint32_t /*id*/, const Box& /*box*/) {});
  if constexpr (is_exact) {
    if (!arrive_later) {
      exact_.converted.end();
      exact_.converted.settle(boxes_.first(n), algorithm_->boxes(), changes_);
    }
  }
  if (arrive_later || replacement.are_many()) {
    changes_.all = true;
  } else {
    replacement.for_each_changed([&](std::uint32_t slot) { changes_.insert(slot); });
  }
  begin(arrive_later ? &replacement : nullptr, nullptr, true);
  if (arrive_later) record();
  if constexpr (is_exact) {
    if (arrive_later) exact_.converted.end();
  }
  many_moved_ = replacement.are_many();
  any_empty_ = any_empty_ || replacement.any_empty();
}

template std::span<Aabb> Core<Aabb>::map(std::size_t n);
template std::span<Aabb64> Core<Aabb64>::map(std::size_t n);
template void Core<Aabb>::begin(const BoxView& boxes);
template void Core<Aabb64>::begin(const BoxView& boxes);
template Delta Core<Aabb>::update(const BoxView& boxes);
template Delta Core<Aabb64>::update(const BoxView& boxes);
template std::shared_ptr<const Saved<Aabb>> Core<Aabb>::save();
template std::shared_ptr<const Saved<Aabb64>> Core<Aabb64>::save();
template Delta Core<Aabb>::restore(const Saved<Aabb>& saved);
template Delta Core<Aabb64>::restore(const Saved<Aabb64>& saved);
template void Core<Aabb>::refuse_replacement(std::size_t boxes) const;
template void Core<Aabb64>::refuse_replacement(std::size_t boxes) const;
template void Core<Aabb>::copy_all(const BoxView& view, bool sets_ids);
template void Core<Aabb64>::copy_all(const BoxView& view, bool sets_ids);
template std::span<Aabb> Core<Aabb>::find_spare();
template std::span<Aabb64> Core<Aabb64>::find_spare();
template bool Core<Aabb>::has_objects(const Saved<Aabb>& saved) noexcept;
template bool Core<Aabb64>::has_objects(const Saved<Aabb64>& saved) noexcept;
template std::optional<std::vector<std::uint32_t>> Core<Aabb>::changed_since(const Saved<Aabb>& saved);
template std::optional<std::vector<std::uint32_t>> Core<Aabb64>::changed_since(const Saved<Aabb64>& saved);
template void Core<Aabb>::set_objects(const Saved<Aabb>& saved);
template void Core<Aabb64>::set_objects(const Saved<Aabb64>& saved);
template void Core<Aabb>::reserve_all(std::size_t n);
template void Core<Aabb64>::reserve_all(std::size_t n);
template void Core<Aabb>::swap_boxes() noexcept;
template void Core<Aabb64>::swap_boxes() noexcept;

}  // namespace broadcl
