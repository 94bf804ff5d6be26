#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <iterator>
#include <span>
#include <string>
#include <vector>

#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>

#include "base/two_sets.hpp"

namespace broadcl {

/// @throws Error for more objects than there are ids.
inline void refuse_too_many_objects(std::size_t objects) {
  constexpr std::size_t most = std::size_t{1} << 31;
  if (objects <= most) return;
  throw Error::invalid_argument(std::to_string(objects) + " objects are too many; use at most " +
                                std::to_string(most));
}

/// Which ids exist, their filters, and their reaches if there are any. Only the functions that reserve memory
/// and copies allocate.
/// @tparam Bound The type of reaches.
template <class Bound>
class ObjectTable {
 public:
  ObjectTable() = default;
  /// @param reach Of all objects, if it is not 0.
  explicit ObjectTable(Bound reach) noexcept : first_reach_(reach), any_reaches_(reach > 0) {}

  /// Reserves memory for all ids below this one.
  /// @throws std::bad_alloc
  void reserve(std::size_t ids) {
    live_.reserve(ids);
    filters_.reserve(ids);
    free_.reserve(ids);
    if (any_reaches_) reaches_.reserve(ids);
  }
  /// Must be called before some reach is not 0. Memory for reaches of as many ids as there is memory for.
  /// @throws std::bad_alloc
  void reserve_reaches() { reaches_.reserve(live_.capacity()); }

  /// The same without the ids from this one on, which must be free, and without memory for them.
  /// @throws std::bad_alloc
  [[nodiscard]] ObjectTable shrunk(std::size_t ids) const {
    ObjectTable result(first_reach_);
    result.any_reaches_ = any_reaches_;
    result.reserve(ids);
    result.live_.assign(live_.begin(), live_.begin() + static_cast<std::ptrdiff_t>(ids));
    result.filters_.assign(filters_.begin(), filters_.begin() + static_cast<std::ptrdiff_t>(ids));
    if (any_reaches_)
      result.reaches_.assign(reaches_.begin(), reaches_.begin() + static_cast<std::ptrdiff_t>(ids));
    std::ranges::copy_if(free_, std::back_inserter(result.free_),
                         [ids](std::uint32_t id) { return id < ids; });
    std::ranges::sort(result.free_);  // which is a heap
    result.size_ = size_;
    result.slots_ = slots_;
    result.any_filters_ = any_filters_;
    result.any_worlds_ = any_worlds_;
    result.sets_ = sets_;
    return result;
  }

  /// The id that add() will return: the lowest that is free.
  [[nodiscard]] std::uint32_t next() const noexcept {
    return free_.empty() ? static_cast<std::uint32_t>(live_.size()) : free_.front();
  }

  /// Filter and reach are those of the last object with this id.
  std::uint32_t add() noexcept {
    const std::uint32_t id = next();
    if (free_.empty()) {
      grow(std::size_t{id} + 1);
    } else {
      std::ranges::pop_heap(free_, std::greater<>());
      free_.pop_back();
    }
    bring_to_life(id);
    return id;
  }

  void remove(std::uint32_t id) noexcept {
    bury(id);
    free_.push_back(id);
    std::ranges::push_heap(free_, std::greater<>());
  }

  /// Makes the ids below n for which lives(id) those of the objects. Calls changed(id) for each object that
  /// is removed, and for each that is added, which has filter and reach of the last object with this id.
  /// @param first All ids below this one live, before and afterwards.
  template <class Lives, class Changed>
  void set_ids(std::size_t first, std::size_t n, const Lives& lives, const Changed& changed) noexcept {
    if (n > ids()) grow(n);
    free_.clear();
    for (auto id = static_cast<std::uint32_t>(first); id < ids(); ++id) {
      const bool is_live = id < n && lives(id);
      if (!is_live) free_.push_back(id);
      if (is_live == contains(id)) continue;
      is_live ? bring_to_life(id) : bury(id);
      changed(id);
    }
  }

  /// @returns Whether it is another one.
  bool set_filter(std::uint32_t id, const Filter& filter) noexcept {
    if (filters_[id] == filter) return false;
    sets_.remove(filters_[id]);
    sets_.add(filter);
    filters_[id] = filter;
    any_filters_ = any_filters_ || filter != Filter();
    any_worlds_ = any_worlds_ || filter.world != 0;
    return true;
  }

  /// @returns Whether it is another one.
  bool set_reach(std::uint32_t id, Bound reach) noexcept {
    if (this->reach(id) == reach) return false;
    if (!any_reaches_) reaches_.resize(ids());
    any_reaches_ = true;
    reaches_[id] = reach;
    return true;
  }

  [[nodiscard]] bool contains(std::uint32_t id) const noexcept { return id < live_.size() && live_[id] != 0; }
  /// @throws Error if no object has this id.
  void refuse_unknown(std::uint32_t id) const {
    if (contains(id)) return;
    throw Error::invalid_argument("no object has the id " + std::to_string(id) +
                                  "; use the ids that add() returned");
  }
  [[nodiscard]] const Filter& filter(std::uint32_t id) const noexcept { return filters_[id]; }
  [[nodiscard]] Bound reach(std::uint32_t id) const noexcept { return any_reaches_ ? reaches_[id] : 0; }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  /// No id was ever this or higher.
  [[nodiscard]] std::size_t ids() const noexcept { return live_.size(); }
  /// No object has this id or a higher one.
  [[nodiscard]] std::size_t slots() noexcept {
    while (slots_ > 0 && live_[slots_ - 1] == 0) --slots_;
    return slots_;
  }

  /// By id: 1 if an object has it, otherwise 0.
  [[nodiscard]] std::span<const std::uint8_t> live() const noexcept { return live_; }
  /// By id; none if all objects that ever were had the default filter.
  [[nodiscard]] std::span<const Filter> filters() const noexcept {
    return any_filters_ ? std::span<const Filter>(filters_) : std::span<const Filter>();
  }
  /// By id; none if all objects that ever were had the reach 0.
  [[nodiscard]] std::span<const Bound> reaches() const noexcept { return reaches_; }
  /// Of an object that is given none.
  [[nodiscard]] Bound first_reach() const noexcept { return first_reach_; }
  [[nodiscard]] bool any_reaches() const noexcept { return any_reaches_; }
  [[nodiscard]] bool any_filters() const noexcept { return any_filters_; }
  [[nodiscard]] bool any_worlds() const noexcept { return any_worlds_; }
  [[nodiscard]] const TwoSets& sets() const noexcept { return sets_; }

 private:
  void grow(std::size_t ids) noexcept {
    live_.resize(ids);
    filters_.resize(ids);
    if (any_reaches_) reaches_.resize(ids, first_reach_);
  }

  void bring_to_life(std::uint32_t id) noexcept {
    live_[id] = 1;
    ++size_;
    slots_ = std::max<std::size_t>(slots_, std::size_t{id} + 1);
    sets_.add(filters_[id]);
  }

  void bury(std::uint32_t id) noexcept {
    live_[id] = 0;
    --size_;
    sets_.remove(filters_[id]);
  }

  std::vector<std::uint8_t> live_;   // by id
  std::vector<Filter> filters_;      // by id
  std::vector<Bound> reaches_;       // by id, if there are any
  std::vector<std::uint32_t> free_;  // a heap, the lowest id first
  std::size_t size_ = 0;
  std::size_t slots_ = 0;
  Bound first_reach_ = 0;
  bool any_reaches_ = false;  // some object has had one other than 0
  bool any_filters_ = false;  // some object has had a filter other than the default
  bool any_worlds_ = false;
  TwoSets sets_;  // of the objects
};

}  // namespace broadcl
