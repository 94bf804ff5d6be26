#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <functional>
#include <iterator>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

#include "base/free_lists.hpp"
#include "base/packed_box.hpp"
#include "base/parallel.hpp"
#include "base/two_sets.hpp"
#include "core/change_set.hpp"
#include "core/exclusions.hpp"
#include "engines/algorithm.hpp"
#include "opencl/process.hpp"

namespace broadcl {

/// Objects, their ids, and what changed. Each function first does everything that may throw; a comment marks
/// where the rest begins, which cannot throw. So a function that throws has changed nothing.
class Core {
 public:
  explicit Core(AlgorithmPointer algorithm) : algorithm_(std::move(algorithm)), boxes_(algorithm_->boxes()) {}

  std::uint32_t add(const Aabb& box, const Filter& filter) {
    refuse_forked();
    const Aabb& packed = pack_or_refuse(box);
    const bool is_new = free_.empty();
    const auto id = is_new ? static_cast<std::uint32_t>(states_.size()) : free_.front();
    reserve(states_.size() + (is_new ? 1 : 0), filter != Filter());
    reserve_late();
    // Nothing below throws.
    if (is_new) {
      grow(states_.size() + 1);
    } else {
      std::ranges::pop_heap(free_, std::greater<>());
      free_.pop_back();
    }
    set_state(id, State::live);
    set_box(id, packed);
    store_filter(id, filter);
    return id;
  }

  void move(std::uint32_t id, const Aabb& box) {
    refuse_forked();
    refuse_unknown(id);
    set_box(id, pack_or_refuse(box));
  }

  void set_filter(std::uint32_t id, const Filter& filter) {
    refuse_unknown(id);
    reserve(states_.size(), filter != Filter());
    // Nothing below throws.
    store_filter(id, filter);
  }

  void set_exclusions(std::span<const Pair> pairs) {
    std::vector<Pair> sorted = sorted_exclusions(pairs);
    std::vector<Pair> changed;
    std::ranges::set_symmetric_difference(exclusions_, sorted, std::back_inserter(changed));
    // Nothing below throws.
    exclusions_ = std::move(sorted);
    for (const Pair& pair : changed) {
      if (pair.b >= states_.size()) continue;
      changes_.insert(pair.a);
      changes_.insert(pair.b);
    }
    changes_.exclusions = changes_.exclusions || !changed.empty();
  }

  void remove(std::uint32_t id) {
    refuse_forked();
    refuse_unknown(id);
    reserve_late();
    // Nothing below throws.
    make_free(id);
    std::ranges::push_heap(free_, std::greater<>());
    set_box(id, packed_empty());
  }

  std::span<Aabb> map(std::size_t n) {
    const std::size_t own = mapped_;  // boxes that the caller has written before
    const std::span<Aabb> boxes = remap(n, n, empty_aabb());
    if (n > own) {  // the caller must not get an error for a NaN that somebody else wrote
      for_each_part(n - own, [&](std::size_t begin, std::size_t end) {
        for (Aabb& box : boxes.subspan(own + begin, end - begin)) {
          if (!is_proper(box)) box = empty_aabb();
        }
      });
    }
    return boxes;
  }

  /// Like map(), but for packed boxes, which begin() need not read. Must not be called between map() and
  /// begin().
  std::span<Aabb> map_packed(std::size_t n) { return remap(n, 0, packed_empty()); }

  void begin() {
    refuse_forked();
    if (is_begun()) return;
    apply_late();
    flight_.reserve(capacity_);  // here, since an update in flight reads it
    or_find_boxes([&] { algorithm_->reserve_exclusions(exclusions_.size()); });
    take_mapped();
    update_ = Update::begun;
    if (changes_.empty()) return;
    std::swap(flight_, changes_);
    flight_.sort_recycled();
    update_ = Update::in_flight;
    or_roll_back([&] {
      const std::size_t slots = slot_count();
      const bool are_two_sets = any_filters_ && sets_.are_apart();
      algorithm_->begin(
          {.boxes = algorithm_->boxes().first(slots),
           .changed = flight_.changed(),
           // If many boxes changed, testing all pairs once is less work than testing the changed boxes
           // against all.
           .all = flight_.all || flight_.changed().size() > slots / 4,
           .recycled = flight_.recycled(),
           .filters = any_filters_ ? std::span<const Filter>(filters_) : std::span<const Filter>(),
           .refiltered = flight_.refiltered(),
           .exclusions = exclusions_,
           .all_filters = flight_.all_filters,
           .filters_changed = flight_.filters,
           .exclusions_changed = flight_.exclusions,
           .worlds = any_worlds_,
           .sets = are_two_sets,
           .sets_decide = are_two_sets && sets_.decide()});
    });
  }

  void flush() {
    if (is_in_flight()) or_roll_back([&] { algorithm_->flush(); });
  }

  Delta finish() {
    begin();
    Delta delta;
    if (is_in_flight()) or_roll_back([&] { delta = algorithm_->finish(); });
    boxes_ = algorithm_->boxes();
    flight_.clear();
    update_ = is_in_flight() ? Update::done : Update::none;
    // If there is no memory yet for objects that were added during the update, the next update allocates it.
    if (has_memory_for(states_.size(), any_filters_)) apply_late();
    return delta;
  }

  /// Gives back memory that the present objects and pairs do not need.
  void shrink() {
    if (is_begun()) throw Error("shrink() was called between begin() and finish(); call finish() first");
    refuse_forked();
    apply_late();
    std::size_t ids = slot_count();  // higher ones that are free need not be stored
    for (const std::uint32_t changed : changes_.changed()) ids = std::max<std::size_t>(ids, changed + 1);
    ChangeSet changes;
    changes.reserve(ids);
    changes.insert(changes_);
    const auto first = [ids](const auto& list) {
      return std::vector(list.begin(), list.begin() + static_cast<std::ptrdiff_t>(ids));
    };
    std::vector<State> states = first(states_);
    std::vector<Filter> filters = first(filters_);
    std::vector<std::uint32_t> free;
    free.reserve(ids);
    std::ranges::copy_if(free_, std::back_inserter(free), [ids](std::uint32_t id) { return id < ids; });
    std::ranges::sort(free);     // which is a heap
    has_filter_memory_ = false;  // even if a part of the following fails
    or_find_boxes([&] { algorithm_->shrink(ids); });
    // Nothing below throws, until all is done.
    boxes_ = algorithm_->boxes();
    states_ = std::move(states);
    filters_ = std::move(filters);
    free_ = std::move(free);
    changes_ = std::move(changes);
    flight_ = {};
    free_lists(late_);
    capacity_ = ids;
    update_ = Update::none;
    exclusions_.shrink_to_fit();
    reserve_algorithm(ids, any_filters_);
  }

  [[nodiscard]] std::vector<Pair> pairs() const {
    refuse_forked();
    if (is_begun()) throw Error("pairs() was called between begin() and finish(); call finish() first");
    return algorithm_->pairs();
  }

  [[nodiscard]] std::span<const Stage> profile() const noexcept {
    return update_ == Update::done ? algorithm_->profile() : std::span<const Stage>();
  }

  [[nodiscard]] const Algorithm& algorithm() const noexcept { return *algorithm_; }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }

 private:
  enum class State : std::uint8_t { free, live };

  /// What became of the last update.
  enum class Update : std::uint8_t {
    none,      // There was nothing to do, or it failed.
    done,      // The algorithm has done it.
    begun,     // There is nothing to do.
    in_flight  // The algorithm is doing it.
  };

  static constexpr std::size_t most_objects = std::size_t{1} << 31;
  static constexpr Aabb empty_box = empty_aabb(), packed_empty_box = packed_empty();
  static constexpr std::size_t least_capacity = 16;  // so that the first objects do not each allocate

  struct LateBox {
    std::uint32_t id;
    Aabb box;  // packed
  };

  /// Whether the algorithm has memory for this many boxes, and for filters if there are any.
  [[nodiscard]] bool has_memory_for(std::size_t ids, bool filters) const noexcept {
    return boxes_.size() >= ids && (has_filter_memory_ || !filters);
  }

  /// Reserves memory for this many ids, so that functions that use these ids need not allocate. During an
  /// update, the algorithm's memory is reserved only after the update.
  void reserve(std::size_t ids, bool filters) {
    if (ids > most_objects) throw Error::invalid_argument("more than 2147483648 objects; use fewer");
    if (ids > capacity_) {
      const std::size_t capacity = std::max({ids, capacity_ + capacity_ / 2, least_capacity});
      states_.reserve(capacity);
      filters_.reserve(capacity);
      free_.reserve(capacity);
      changes_.reserve(capacity);
      capacity_ = capacity;
    }
    if (!is_in_flight()) reserve_algorithm(ids, filters || any_filters_);
  }

  void reserve_algorithm(std::size_t ids, bool filters) {
    if (has_memory_for(ids, filters)) return;
    or_find_boxes([&] { algorithm_->reserve(ids, filters || has_filter_memory_); });
    boxes_ = algorithm_->boxes();
    has_filter_memory_ = has_filter_memory_ || filters;
  }

  void reserve_late() {
    if (is_late() && late_.size() == late_.capacity()) late_.reserve(2 * late_.size() + 16);
  }

  void grow(std::size_t ids) noexcept {
    states_.resize(ids, State::free);
    filters_.resize(ids);
  }

  void set_state(std::uint32_t id, State state) noexcept {
    states_[id] = state;
    if (state == State::live) {
      ++size_;
      slots_ = std::max<std::size_t>(slots_, id + 1);
      sets_.add(filters_[id]);
    } else {
      --size_;
      sets_.remove(filters_[id]);
    }
    changes_.recycle(id);
  }

  void make_free(std::uint32_t id) noexcept {
    set_state(id, State::free);
    free_.push_back(id);
  }

  /// Whether a box that is set now has to be stored later, because the algorithm is reading its boxes, or
  /// because earlier boxes are still waiting.
  [[nodiscard]] bool is_late() const noexcept { return is_in_flight() || !late_.empty(); }

  [[nodiscard]] bool is_in_flight() const noexcept { return update_ == Update::in_flight; }
  [[nodiscard]] bool is_begun() const noexcept { return update_ == Update::begun || is_in_flight(); }

  void set_box(std::uint32_t id, const Aabb& packed) {
    if (is_late()) {
      set_box_later(id, packed);
    } else {
      store_box(id, packed);
    }
  }

  /// (Not inlined, since move() is called for each object.)
  [[gnu::noinline]] void set_box_later(std::uint32_t id, const Aabb& packed) {
    late_.push_back({id, packed});
  }

  void store_box(std::uint32_t id, const Aabb& packed) noexcept {
    // Among boxes that the caller writes in place, a NaN would be the caller's.
    const Aabb& box = id < mapped_ && !is_proper(packed) ? empty_box : packed;
    Aabb& old = boxes_[id];
    if (same_bits(old, box)) return;
    old = box;
    changes_.insert(id);
  }

  void store_filter(std::uint32_t id, const Filter& filter) noexcept {
    if (filters_[id] == filter) return;
    sets_.remove(filters_[id]);
    sets_.add(filter);
    filters_[id] = filter;
    any_filters_ = any_filters_ || filter != Filter();
    any_worlds_ = any_worlds_ || filter.world != 0;
    changes_.refilter(id);
  }

  /// Stores the boxes that were set while an update was in flight.
  void apply_late() {
    reserve_algorithm(states_.size(), any_filters_);
    // Nothing below throws.
    for (const LateBox& late : late_) store_box(late.id, late.box);
    late_.clear();
  }

  /// @param mapped How many of the boxes begin() has to pack.
  /// @param empty The boxes of new objects.
  std::span<Aabb> remap(std::size_t n, std::size_t mapped, const Aabb& empty) {
    refuse_forked();
    if (is_begun()) throw Error("boxes cannot be mapped between begin() and finish(); call finish() first");
    if (n > most_objects)
      throw Error::invalid_argument(std::to_string(n) + " boxes are too many to map; use at most " +
                                    std::to_string(most_objects));
    apply_late();
    reserve(std::max(n, states_.size()), false);
    // Nothing below throws.
    if (n > states_.size()) grow(n);
    mapped_ = mapped;
    free_.clear();
    for (auto id = static_cast<std::uint32_t>(n); id < states_.size(); ++id) {
      if (states_[id] == State::live) {
        make_free(id);
        set_box(id, packed_empty());
      } else {
        free_.push_back(id);
      }
    }
    const std::span<Aabb> boxes = boxes_.first(n);
    for (std::uint32_t id = 0; size_ < n; ++id) {
      if (states_[id] == State::live) continue;
      boxes[id] = empty;
      set_state(id, State::live);
      store_filter(id, Filter());
    }
    changes_.all = true;
    return boxes;
  }

  /// Packs the boxes that the caller wrote in place.
  void take_mapped() {
    const std::span<Aabb> boxes = boxes_.first(mapped_);
    std::atomic<bool> any_empty = false;
    std::atomic<std::size_t> first_nan = boxes.size();
    for_each_part(boxes.size(), [&](std::size_t begin, std::size_t end) {
      bool is_any_empty = false;
      for (std::size_t id = begin; id < end; ++id) {
        if (is_proper(boxes[id])) continue;
        is_any_empty = true;
        if (!has_nan(boxes[id])) continue;
        for (std::size_t first = first_nan; id < first && !first_nan.compare_exchange_weak(first, id);) {
        }
        break;
      }
      if (is_any_empty) any_empty = true;
    });
    if (first_nan < boxes.size()) throw_nan("box " + std::to_string(first_nan));
    // Nothing below throws.
    if (any_empty) {
      for_each_part(boxes.size(), [&](std::size_t begin, std::size_t end) {
        for (Aabb& box : boxes.subspan(begin, end - begin)) {
          if (!is_proper(box)) box = packed_empty();
        }
      });
    }
    mapped_ = 0;
  }

  /// Reserves memory of the algorithm, which may store the boxes elsewhere even if that fails.
  template <class Function>
  void or_find_boxes(const Function& function) {
    try {
      function();
    } catch (...) {
      boxes_ = algorithm_->boxes();
      throw;
    }
  }

  /// Does a part of an update. If it fails, the next update finds the changes of this one, too.
  template <class Function>
  void or_roll_back(const Function& function) {
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

  /// Slots up to the last object.
  [[nodiscard]] std::size_t slot_count() noexcept {
    while (slots_ > 0 && states_[slots_ - 1] != State::live) --slots_;
    return slots_;
  }

  void refuse_unknown(std::uint32_t id) const {
    if (id >= states_.size() || states_[id] == State::free) {
      throw Error::invalid_argument("no object has the id " + std::to_string(id) +
                                    "; use the ids that add() returned");
    }
  }

  /// (Memory of a device may not be there after a fork.)
  void refuse_forked() const {
    if (opencl::is_forked() && algorithm_->device() != nullptr) opencl::use_in_this_process();
  }

  /// @returns The box, or one that lives as long as the program.
  static const Aabb& pack_or_refuse(const Aabb& box) {
    if (is_proper(box)) return box;
    if (has_nan(box)) throw_nan("a box");
    return packed_empty_box;
  }

  AlgorithmPointer algorithm_;
  std::span<Aabb> boxes_;            // the algorithm's
  bool has_filter_memory_ = false;   // in the algorithm
  std::size_t capacity_ = 0;         // ids that the following have capacity for
  std::vector<State> states_;        // by id
  std::vector<Filter> filters_;      // by id
  std::vector<Pair> exclusions_;     // in canonical order
  std::vector<std::uint32_t> free_;  // a heap, the lowest id first
  std::size_t size_ = 0;
  std::size_t slots_ = 0;     // no object has this id or a higher one
  bool any_filters_ = false;  // some object has had a filter other than the default
  bool any_worlds_ = false;
  TwoSets sets_;            // of the objects
  std::size_t mapped_ = 0;  // boxes that the caller may have written in place

  ChangeSet changes_;  // since the last update began
  ChangeSet flight_;   // the changes that the update in flight applies
  Update update_ = Update::none;
  std::vector<LateBox> late_;
};

}  // namespace broadcl
