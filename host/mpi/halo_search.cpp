#include "mpi/halo_search.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include "base/box_parts.hpp"

namespace broadcl::mpi {
namespace {

/// Removes pairs from a list.
/// @param some In canonical order.
void subtract(std::vector<MpiPair>& pairs, std::span<const MpiPair> some) {
  std::erase_if(pairs, [&](const MpiPair& pair) { return std::ranges::binary_search(some, pair); });
}

/// @param pairs Null or in canonical order.
bool contains(const std::shared_ptr<const std::vector<MpiPair>>& pairs, const MpiPair& pair) {
  return pairs && std::ranges::binary_search(*pairs, pair);
}

/// @param positions Ascending, at least one.
void erase_at(std::vector<std::uint32_t>& values, std::span<const std::uint32_t> positions) {
  auto end = values.begin() + positions.front();
  for (std::size_t k = 0; k < positions.size(); ++k) {
    const auto next = k + 1 < positions.size() ? values.begin() + positions[k + 1] : values.end();
    end = std::copy(values.begin() + positions[k] + 1, next, end);
  }
  values.erase(end, values.end());
}

}  // namespace

HaloSearch::HaloSearch(const Config& config, std::size_t rank, std::size_t ranks)
    : rank_(rank), threads_(config), search_(config), sources_(ranks), changes_(ranks), relocated_(ranks) {}

void HaloSearch::clear() {
  search_.map(0);
  (void)search_.update();
  slots_.clear();
  free_.clear();
  for (Source& source : sources_) {
    source.ids.clear();
    source.slots.clear();
    source.exclusions = source.last_exclusions;
    source.changes = {};
  }
  freed_.clear();
  fresh_.clear();
  written_.clear();
  written_boxes_.clear();
  has_relocated_ = false;
}

Filter HaloSearch::search_filter(const Slot& slot) const noexcept {
  Filter filter = slot.filter;
  filter.body = static_cast<std::size_t>(rank_of(slot.object)) == rank_ ? 1 : 0;
  return filter;
}

std::uint32_t HaloSearch::allocate(const Slot& slot) {
  std::uint32_t number = 0;
  if (free_.empty()) {
    slots_.push_back(slot);
    number = search_.add(empty_aabb(), search_filter(slot));  // All slots have objects: it is the next one.
  } else {
    number = free_.back();
    search_.set_filter(number, search_filter(slot));
    slots_[number] = slot;
    free_.pop_back();
  }
  fresh_.push_back(number);
  return number;
}

void HaloSearch::write(std::uint32_t slot, const Aabb& box) {
  written_.push_back(slot);
  written_boxes_.push_back(box);
}

/// The slot is used again in the next update at the earliest, so that all pairs of this one are known.
void HaloSearch::release(std::uint32_t slot) {
  freed_.push_back(slot);
  write(slot, empty_aabb());
}

void HaloSearch::refilter(std::uint32_t slot, const Filter& filter) {
  slots_[slot].filter = filter;
  search_.set_filter(slot, search_filter(slots_[slot]));
}

/// An object that has just come to its slot stays there: all of its pairs are compared anyway.
void HaloSearch::relocate(Source& source, std::size_t position, const Filter& filter) {
  const std::uint32_t old = source.slots[position];
  if (slots_[old].is_fresh) return refilter(old, filter);
  const Aabb box = search_.box(old);
  const std::uint32_t other =
      allocate({.object = slots_[old].object, .filter = filter, .is_new = false, .is_fresh = true});
  write(other, box);
  release(old);
  source.slots[position] = other;
  has_relocated_ = true;
}

void HaloSearch::leave(Source& source, std::span<const std::uint32_t> positions) {
  if (positions.empty()) return;
  for (const std::uint32_t position : positions) release(source.slots[position]);
  erase_at(source.ids, positions);
  erase_at(source.slots, positions);
}

void HaloSearch::enter(Source& source, std::size_t from, const HaloChanges& changes) {
  if (changes.entered.empty()) return;
  std::vector<std::uint32_t> ids;
  std::vector<std::uint32_t> slots;
  ids.reserve(source.ids.size() + changes.entered.size());
  slots.reserve(ids.capacity());
  auto old = source.ids.begin();
  const auto keep_until = [&](std::vector<std::uint32_t>::iterator end) {
    const auto slot = source.slots.begin() + (old - source.ids.begin());
    slots.insert(slots.end(), slot, slot + (end - old));
    ids.insert(ids.end(), std::exchange(old, end), end);
  };
  for (std::size_t k = 0; k < changes.entered.size(); ++k) {
    const std::uint32_t id = changes.entered[k];
    keep_until(std::lower_bound(old, source.ids.end(), id));
    const std::uint32_t slot = allocate({.object = mpi_id(static_cast<int>(from), id),
                                         .filter = changes.entered_filters[k],
                                         .is_new = true,
                                         .is_fresh = true});
    write(slot, changes.entered_boxes[k]);
    ids.push_back(id);
    slots.push_back(slot);
  }
  keep_until(source.ids.end());
  source.ids.swap(ids);
  source.slots.swap(slots);
}

/// Relocates the objects of the other rank whose exclusions change.
void HaloSearch::set_exclusions(std::size_t other, std::span<const MpiPair> exclusions) {
  Source& source = sources_[other];
  std::vector<MpiPair> last;
  if (source.last_exclusions) last = *source.last_exclusions;
  std::vector<MpiPair> changed;
  std::ranges::set_symmetric_difference(last, exclusions, std::back_inserter(changed));
  for (const MpiPair& pair : changed) {
    const MpiId object = static_cast<std::size_t>(rank_of(pair.a)) == other ? pair.a : pair.b;
    const auto id = std::ranges::lower_bound(source.ids, local_id(object));
    if (id == source.ids.end() || *id != local_id(object)) continue;
    const auto position = static_cast<std::size_t>(id - source.ids.begin());
    relocate(source, position, slots_[source.slots[position]].filter);
  }
  source.exclusions = std::make_shared<std::vector<MpiPair>>(exclusions.begin(), exclusions.end());
}

void HaloSearch::receive(std::size_t from, const HaloChanges& changes) {
  Source& source = sources_[from];
  source.changes = changes;
  leave(source, changes.left);
  enter(source, from, changes);
  if (changes.has_exclusions) set_exclusions(from, changes.exclusions);
  for (std::size_t k = 0; k < changes.refiltered.size(); ++k) {
    const std::size_t position = changes.refiltered[k];
    const Filter& filter = changes.new_filters[k];
    const std::uint32_t slot = source.slots[position];
    if (slots_[slot].filter.body != filter.body) {
      relocate(source, position, filter);
    } else {
      refilter(slot, filter);
    }
  }
}

HaloSearch::Found HaloSearch::found(const Pair& slots) const noexcept {
  const MpiId s = slots_[slots.a].object;
  const MpiId t = slots_[slots.b].object;
  const auto rank = static_cast<std::size_t>(rank_of(s));
  return {.pair = {.a = std::min(s, t), .b = std::max(s, t)},
          .other_rank = rank == rank_ ? static_cast<std::size_t>(rank_of(t)) : rank};
}

bool HaloSearch::share_body(const Pair& slots) const noexcept {
  const std::uint32_t body = slots_[slots.a].filter.body;
  return body != Filter::no_body && body == slots_[slots.b].filter.body;
}

void HaloSearch::write_boxes() {
  std::size_t count = written_.size();
  for (const Source& source : sources_) count += source.changes.moved.size();
  if (4 * count > slots_.size()) {
    const std::span<Aabb> boxes = search_.map(slots_.size());
    for (std::size_t k = 0; k < written_.size(); ++k) boxes[written_[k]] = written_boxes_[k];
    for (const Source& source : sources_) {
      const HaloChanges& changes = source.changes;
      for_each_part(changes.moved.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t) {
        for (std::size_t k = begin; k < end; ++k)
          boxes[source.slots[changes.moved[k]]] = changes.moved_boxes[k];
      });
    }
  } else {
    for (const Source& source : sources_) {
      for (std::size_t k = 0; k < source.changes.moved.size(); ++k) {
        write(source.slots[source.changes.moved[k]], source.changes.moved_boxes[k]);
      }
    }
    search_.move(written_, BoxView(written_boxes_));
  }
  for (Source& source : sources_) source.changes = {};
  written_.clear();
  written_boxes_.clear();
}

void HaloSearch::find() {
  free_.reserve(free_.size() + freed_.size());
  write_boxes();
  for (PairChanges& changes : changes_) {
    changes.added.clear();
    changes.removed.clear();
  }
  for (std::vector<MpiPair>& pairs : relocated_) pairs.clear();
  const Delta delta = search_.update();
  for (const Pair& slots : delta.added) {
    const auto [pair, rank] = found(slots);
    if (share_body(slots) || contains(sources_[rank].exclusions, pair)) continue;
    changes_[rank].added.push_back(pair);
    if (has_relocated_ && !slots_[slots.a].is_new && !slots_[slots.b].is_new) {
      relocated_[rank].push_back(pair);
    }
  }
  for (const Pair& slots : delta.removed) {
    const auto [pair, rank] = found(slots);
    if (share_body(slots) || contains(sources_[rank].last_exclusions, pair)) continue;
    changes_[rank].removed.push_back(pair);
  }
  for (PairChanges& changes : changes_) {
    std::ranges::sort(changes.added);
    std::ranges::sort(changes.removed);
  }
  if (has_relocated_) cancel_relocated();
}

/// A pair is in both lists if its objects only moved to other slots.
void HaloSearch::cancel_relocated() {
  for (std::size_t rank = 0; rank < changes_.size(); ++rank) {
    PairChanges& changes = changes_[rank];
    std::ranges::sort(relocated_[rank]);
    std::vector<MpiPair> both;
    std::ranges::set_intersection(relocated_[rank], changes.removed, std::back_inserter(both));
    subtract(changes.added, both);
    subtract(changes.removed, both);
  }
}

void HaloSearch::commit() noexcept {
  for (const std::uint32_t slot : fresh_) slots_[slot].is_new = slots_[slot].is_fresh = false;
  fresh_.clear();
  free_.insert(free_.end(), freed_.begin(), freed_.end());  // within its capacity
  freed_.clear();
  has_relocated_ = false;
  for (Source& source : sources_) source.last_exclusions = source.exclusions;
}

std::vector<std::vector<MpiPair>> HaloSearch::pairs() const {
  std::vector<std::vector<MpiPair>> pairs(sources_.size());
  for (const Pair& slots : search_.pairs()) {
    const auto [pair, rank] = found(slots);
    if (!share_body(slots) && !contains(sources_[rank].last_exclusions, pair)) pairs[rank].push_back(pair);
  }
  for (std::vector<MpiPair>& some : pairs) std::ranges::sort(some);
  return pairs;
}

}  // namespace broadcl::mpi
