#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <functional>
#include <iterator>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

#include "base/free_lists.hpp"
#include "base/packed_box.hpp"
#include "base/parallel.hpp"
#include "core/box_moves.hpp"
#include "core/box_replacement.hpp"
#include "core/change_set.hpp"
#include "core/exclusions.hpp"
#include "core/object_table.hpp"
#include "engines/algorithm.hpp"
#include "opencl/process.hpp"

namespace broadcl {

/// Objects, their ids, and what changed. Each function first does everything that may throw; a comment
/// marks where the rest begins, which cannot throw. So a function that throws has changed nothing.
class Core {
 public:
  /// @param threads That copy boxes, at most; 0 for one per processor.
  explicit Core(AlgorithmPointer algorithm, std::size_t threads = 0)
      : algorithm_(std::move(algorithm)),
        boxes_(algorithm_->boxes()),
        threads_(threads),
        replacement_(threads) {}

  std::uint32_t add(const Aabb& box, const Filter& filter) {
    refuse_forked();
    const Aabb& packed = pack_or_refuse(box);
    reserve(std::max<std::size_t>(objects_.ids(), std::size_t{objects_.next()} + 1), filter != Filter());
    reserve_late(1);
    // Nothing below throws.
    return add_packed(packed, filter);
  }

  /// @param filters One for all boxes, or as many as boxes.
  std::vector<std::uint32_t> add(const BoxView& boxes, std::span<const Filter> filters) {
    refuse_forked();
    if (filters.size() != 1 && filters.size() != boxes.size()) {
      throw Error::invalid_argument(std::to_string(filters.size()) + " filters for " +
                                    std::to_string(boxes.size()) +
                                    " boxes; give one for all, or one for each");
    }
    if (boxes.size() > most_objects) throw_too_many();
    const std::vector<Aabb> packed = pack_or_refuse(boxes);
    const bool any_filters = std::ranges::any_of(filters, [](const Filter& f) { return f != Filter(); });
    std::vector<std::uint32_t> ids(packed.size());
    // (Perhaps some have free ids.)
    const std::size_t free = objects_.ids() - objects_.size();
    reserve(objects_.ids() + packed.size() - std::min(free, packed.size()), any_filters);
    reserve_late(packed.size());
    // Nothing below throws.
    for (std::size_t k = 0; k < packed.size(); ++k) {
      ids[k] = add_packed(packed[k], filters[filters.size() == 1 ? 0 : k]);
    }
    return ids;
  }

  void move(std::uint32_t id, const Aabb& box) {
    refuse_forked();
    objects_.refuse_unknown(id);
    set_box(id, pack_or_refuse(box));
  }

  void move(std::span<const std::uint32_t> ids, const BoxView& boxes) {
    refuse_forked();
    if (ids.size() != boxes.size()) {
      throw Error::invalid_argument(std::to_string(ids.size()) + " ids and " + std::to_string(boxes.size()) +
                                    " boxes; give as many of both");
    }
    BoxMoves moves(ids, boxes, objects_, threads_);
    reserve_late(ids.size());
    // Nothing below throws.
    if (is_late() || mapped_ > 0) {
      return moves.for_each([&](std::uint32_t id, const Aabb& packed) { set_box(id, packed); });
    }
    moves.store(boxes_);
    any_empty_ = any_empty_ || moves.any_empty();
    if (moves.changed_count() > objects_.slots() / 4) {
      changes_.all = true;
    } else {
      moves.for_each_changed([&](std::uint32_t id) { changes_.insert(id); });
    }
  }

  void set_filter(std::uint32_t id, const Filter& filter) {
    objects_.refuse_unknown(id);
    reserve(objects_.ids(), filter != Filter());
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
      if (pair.b >= objects_.ids()) continue;
      changes_.insert(pair.a);
      changes_.insert(pair.b);
    }
    changes_.exclusions = changes_.exclusions || !changed.empty();
  }

  void remove(std::uint32_t id) { remove({&id, 1}); }

  void remove(std::span<const std::uint32_t> ids) {
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

  [[nodiscard]] bool contains(std::uint32_t id) const noexcept { return objects_.contains(id); }

  [[nodiscard]] Aabb box(std::uint32_t id) const {
    refuse_forked();
    objects_.refuse_unknown(id);
    const auto late = std::ranges::find(late_.rbegin(), late_.rend(), id, &LateBox::id);
    const Aabb& box = late != late_.rend() ? late->box : boxes_[id];
    return id >= mapped_ && has_nan(box) ? empty_aabb() : box;
  }

  [[nodiscard]] const Filter& filter(std::uint32_t id) const {
    objects_.refuse_unknown(id);
    return objects_.filter(id);
  }

  std::span<Aabb> map(std::size_t n) {
    const std::size_t own = mapped_;  // boxes that the caller has written before
    const std::span<Aabb> boxes = remap(n, n, empty_aabb());
    if (n > own && any_empty_) {  // the caller must not get an error for a NaN that somebody else wrote
      for_each_part(n - own, [&](std::size_t begin, std::size_t end) {
        for (Aabb& box : boxes.subspan(own + begin, end - begin)) {
          if (!is_proper(box)) box = empty_aabb();
        }
      });
      any_empty_ = false;
    }
    return boxes;
  }

  /// Like map(), but for packed boxes, which begin() need not read. Must not be called between map() and
  /// begin().
  std::span<Aabb> map_packed(std::size_t n) {
    any_empty_ = true;
    return remap(n, 0, packed_empty());
  }

  void begin() { begin(nullptr); }

  /// Replaces all boxes, and begins the update.
  void begin(const BoxView& boxes) {
    replace_all(boxes, [&] { flush(); });
  }

  Delta update(const BoxView& boxes) {
    Delta delta;
    replace_all(boxes, [&] { delta = finish(); });
    return delta;
  }

  /// @param write Writes the boxes, all of which count as changed. Null if they are written.
  void begin(const WriteBoxes* write) {
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
      const std::size_t slots = objects_.slots();
      const bool are_two_sets = objects_.any_filters() && objects_.sets().are_apart();
      algorithm_->begin({.boxes = algorithm_->boxes().first(slots),
                         .write = write,
                         .changed = flight_.changed(),
                         // If many boxes changed, testing all pairs once is less work than testing the
                         // changed boxes against all.
                         .all = flight_.all || flight_.changed().size() > slots / 4,
                         .recycled = flight_.recycled(),
                         .filters = objects_.filters(),
                         .refiltered = flight_.refiltered(),
                         .exclusions = exclusions_,
                         .all_filters = flight_.all_filters,
                         .filters_changed = flight_.filters,
                         .exclusions_changed = flight_.exclusions,
                         .worlds = objects_.any_worlds(),
                         .sets = are_two_sets,
                         .sets_decide = are_two_sets && objects_.sets().decide()});
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
    if (has_memory_for(objects_.ids(), objects_.any_filters())) apply_late();
    return delta;
  }

  /// Gives back memory that the present objects and pairs do not need.
  void shrink() {
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
    free_lists(late_);
    replacement_.clear();
    capacity_ = ids;
    update_ = Update::none;
    exclusions_.shrink_to_fit();
    reserve_algorithm(ids, objects_.any_filters());
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
  [[nodiscard]] std::size_t size() const noexcept { return objects_.size(); }

 private:
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
    if (ids > most_objects) throw_too_many();
    if (ids > capacity_) {
      const std::size_t capacity = std::max({ids, capacity_ + capacity_ / 2, least_capacity});
      objects_.reserve(capacity);
      changes_.reserve(capacity);
      capacity_ = capacity;
    }
    if (!is_in_flight()) reserve_algorithm(ids, filters || objects_.any_filters());
  }

  void reserve_algorithm(std::size_t ids, bool filters) {
    if (has_memory_for(ids, filters)) return;
    or_find_boxes([&] { algorithm_->reserve(ids, filters || has_filter_memory_); });
    boxes_ = algorithm_->boxes();
    has_filter_memory_ = has_filter_memory_ || filters;
  }

  void reserve_late(std::size_t count) {
    if (is_late() && late_.capacity() - late_.size() < count) late_.reserve(2 * late_.size() + 16 + count);
  }

  std::uint32_t add_packed(const Aabb& packed, const Filter& filter) noexcept {
    const std::uint32_t id = objects_.add();
    changes_.recycle(id);
    set_box(id, packed);
    store_filter(id, filter);
    return id;
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
    const bool is_empty = !is_proper(packed);
    const Aabb& box = id < mapped_ && is_empty ? empty_box : packed;
    any_empty_ = any_empty_ || is_empty;
    Aabb& old = boxes_[id];
    if (same_bits(old, box)) return;
    old = box;
    changes_.insert(id);
  }

  void store_filter(std::uint32_t id, const Filter& filter) noexcept {
    if (objects_.set_filter(id, filter)) changes_.refilter(id);
  }

  /// Stores the boxes that were set while an update was in flight.
  void apply_late() {
    reserve_algorithm(objects_.ids(), objects_.any_filters());
    // Nothing below throws.
    for (const LateBox& late : late_) store_box(late.id, late.box);
    late_.clear();
  }

  /// Reserves memory for the boxes of 0 .. n-1.
  void reserve_all(std::size_t n) {
    refuse_forked();
    if (is_begun()) throw Error("boxes cannot be replaced between begin() and finish(); call finish() first");
    if (n > most_objects) {
      throw Error::invalid_argument(std::to_string(n) + " objects are too many; use at most " +
                                    std::to_string(most_objects));
    }
    apply_late();
    reserve(std::max(n, objects_.ids()), false);
  }

  /// Makes 0 .. n-1 the ids of the objects. The memory must be reserved.
  /// @param set Called with ids, and with the boxes of those that are removed or added.
  /// @param empty Boxes of objects that are added.
  template <class SetBox>
  void set_ids(std::size_t n, const Aabb& empty, const SetBox& set) noexcept {
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

  /// @param mapped How many of the boxes begin() has to pack.
  /// @param empty The boxes of new objects.
  std::span<Aabb> remap(std::size_t n, std::size_t mapped, const Aabb& empty) {
    reserve_all(n);
    // Nothing below throws.
    mapped_ = mapped;
    set_ids(n, empty, [&](std::uint32_t id, const Aabb& box) { boxes_[id] = box; });
    changes_.all = true;
    return boxes_.first(n);
  }

  /// Makes the boxes of a view those of all objects, and begins an update. If this or `end` fails, everything
  /// is as before.
  template <class Function>
  void replace_all(const BoxView& view, const Function& end) {
    const std::size_t n = view.size();
    reserve_all(n);
    replacement_.begin(n, std::max(n, objects_.ids()));
    const bool most_move = many_moved_;
    if (most_move) or_find_boxes([&] { (void)algorithm_->spare_boxes(); });
    const bool same_ids = objects_.size() == n && objects_.slots() == n;
    std::optional<std::pair<ObjectTable, ChangeSet>> before;
    if (!same_ids) {
      before.emplace(objects_, changes_);
      before->first.reserve(capacity_);
      before->second.reserve(capacity_);
    }
    const std::size_t mapped = std::exchange(mapped_, 0);
    if (most_move) swap_boxes();
    try {
      most_move ? copy_all(view) : replace_in_place(view);
      end();
    } catch (...) {
      if (most_move) {
        swap_boxes();
      } else {
        replacement_.undo(boxes_);
      }
      mapped_ = mapped;
      if (before) std::tie(objects_, changes_) = std::move(*before);
      changes_.all = changes_.all_filters = true;
      try {
        throw;
      } catch (const InvalidBox& box) {
        throw_nan("box " + std::to_string(box.index));
      }
    }
  }

  void swap_boxes() noexcept {
    algorithm_->swap_boxes();
    boxes_ = algorithm_->boxes();
  }

  /// Copies all boxes, while a device receives those before, and begins the update.
  void copy_all(const BoxView& view) {
    const std::size_t n = view.size();
    const std::span<const Aabb> before = algorithm_->spare_boxes();
    const WriteBoxes write = [&](const std::function<void()>& meanwhile, const BoxesWritten& written) {
      replacement_.copy(view, before, boxes_, meanwhile, written);
    };
    const bool writes_later = algorithm_->uploads_boxes();
    if (!writes_later) write(nullptr, nullptr);
    set_ids(n, packed_empty(), [&](std::uint32_t id, const Aabb& box) {
      if (id >= n) boxes_[id] = box;
    });
    changes_.all = true;
    begin(writes_later ? &write : nullptr);
    many_moved_ = replacement_.count() > n / 4;
    any_empty_ = any_empty_ || replacement_.any_empty();
  }

  /// Replaces the boxes that change, and begins the update.
  void replace_in_place(const BoxView& view) {
    const std::size_t n = view.size();
    replacement_.replace(view, boxes_);
    set_ids(n, packed_empty(), [&](std::uint32_t id, const Aabb& box) {
      if (id >= n) replacement_.replace(id, box, boxes_);
    });
    many_moved_ = replacement_.count() > n / 4;
    any_empty_ = any_empty_ || replacement_.any_empty();
    if (many_moved_) {
      changes_.all = true;
    } else {
      replacement_.for_each([&](std::uint32_t slot) { changes_.insert(slot); });
    }
    begin();
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
      any_empty_ = true;
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

  [[noreturn]] static void throw_too_many() {
    throw Error::invalid_argument("more than " + std::to_string(most_objects) + " objects; use fewer");
  }

  static void refuse_twice(std::span<const std::uint32_t> ids) {
    if (ids.size() < 2) return;
    std::vector<std::uint32_t> sorted(ids.begin(), ids.end());
    std::ranges::sort(sorted);
    const auto twice = std::ranges::adjacent_find(sorted);
    if (twice != sorted.end()) {
      throw Error::invalid_argument("the id " + std::to_string(*twice) + " is given twice; give each once");
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

  static std::vector<Aabb> pack_or_refuse(const BoxView& boxes) {
    std::vector<Aabb> packed(boxes.size());
    boxes.pack_to(packed);
    return packed;
  }

  AlgorithmPointer algorithm_;
  std::span<Aabb> boxes_;           // the algorithm's
  std::size_t threads_;             // that copy boxes
  bool has_filter_memory_ = false;  // in the algorithm
  std::size_t capacity_ = 0;        // ids that the following have capacity for
  ObjectTable objects_;
  std::vector<Pair> exclusions_;  // in canonical order
  std::size_t mapped_ = 0;        // boxes that the caller may have written in place
  bool any_empty_ = false;        // some box may be packed_empty()

  ChangeSet changes_;  // since the last update began
  ChangeSet flight_;   // the changes that the update in flight applies
  Update update_ = Update::none;
  std::vector<LateBox> late_;
  BoxReplacement replacement_;
  bool many_moved_ = true;  // in the last replacement
};

}  // namespace broadcl
