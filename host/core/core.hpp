#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

#include "base/packed_box.hpp"
#include "core/change_set.hpp"
#include "core/late_boxes.hpp"
#include "core/object_table.hpp"
#include "engines/algorithm.hpp"
#include "opencl/process.hpp"

namespace broadcl {

/// Called for the boxes from `begin` to `end`, one of the parts of for_each_part(), by one of several
/// threads.
using LookAtBoxes = std::function<void(std::size_t begin, std::size_t end, std::span<const Aabb> boxes)>;

/// Objects, their ids, and what changed. Each function first does everything that may throw; a comment
/// marks where the rest begins, which cannot throw. So a function that throws has changed nothing.
class BROADCL_API Core {
 public:
  /// @param threads That copy boxes, at most; 0 for one per processor.
  explicit Core(AlgorithmPointer algorithm, std::size_t threads = 0)
      : algorithm_(std::move(algorithm)), boxes_(algorithm_->boxes()), threads_(threads) {}

  std::uint32_t add(const Aabb& box, const Filter& filter) {
    refuse_forked();
    const Aabb& packed = pack_or_refuse(box);
    reserve(std::max<std::size_t>(objects_.ids(), std::size_t{objects_.next()} + 1), filter != Filter());
    reserve_late(1);
    // Nothing below throws.
    return add_packed(packed, filter);
  }

  /// @param filters One for all boxes, or as many as boxes.
  std::vector<std::uint32_t> add(const BoxView& boxes, std::span<const Filter> filters);

  void move(std::uint32_t id, const Aabb& box) {
    refuse_forked();
    objects_.refuse_unknown(id);
    const Aabb& packed = pack_or_refuse(box);
    reserve_late(1);
    // Nothing below throws.
    set_box(id, packed);
  }

  void move(std::span<const std::uint32_t> ids, const BoxView& boxes);

  void set_filter(std::uint32_t id, const Filter& filter);
  void set_exclusions(std::span<const Pair> pairs);

  void remove(std::uint32_t id) { remove({&id, 1}); }
  void remove(std::span<const std::uint32_t> ids);

  [[nodiscard]] bool contains(std::uint32_t id) const noexcept { return objects_.contains(id); }

  [[nodiscard]] Aabb box(std::uint32_t id) const;
  [[nodiscard]] const Filter& filter(std::uint32_t id) const;
  /// By id; none if all objects that ever were had the default filter.
  [[nodiscard]] std::span<const Filter> filters() const noexcept { return objects_.filters(); }
  /// Of the update that was begun, packed, by id; empty for ids that are free.
  [[nodiscard]] std::span<const Aabb> boxes() const noexcept { return boxes_.first(objects_.ids()); }

  std::span<Aabb> map(std::size_t n);
  /// What functions throw for these numbers of boxes, ids and filters before they do anything: map() and
  /// begin(), add(), and move().
  void refuse_replacement(std::size_t boxes) const;
  static void refuse_addition(std::size_t boxes, std::size_t filters);
  static void refuse_moves(std::size_t ids, std::size_t boxes);

  /// Like map(), but for packed boxes, which begin() need not read. Must not be called between map() and
  /// begin().
  std::span<Aabb> map_packed(std::size_t n);

  void begin() { begin(nullptr, nullptr); }
  /// @param look Called for each part of the boxes of map() when begin() has just read them, so that they
  /// need not be read from memory twice. Boxes that are empty or have a NaN are still as the caller wrote
  /// them.
  /// @throws What `look` throws; there is no update then.
  void begin(const LookAtBoxes& look) { begin(nullptr, &look); }
  void begin(const BoxView& boxes);
  void flush();
  Delta finish();
  Delta update(const BoxView& boxes);

  /// Gives back memory that the present objects and pairs do not need.
  void shrink();

  [[nodiscard]] std::vector<Pair> pairs() const;

  /// @param listener Of each update that has something to do. Must outlive this object.
  void set_listener(PairListener& listener) noexcept { listener_ = &listener; }

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

  /// Whether the algorithm has memory for this many boxes, and for filters if there are any.
  [[nodiscard]] bool has_memory_for(std::size_t ids, bool filters) const noexcept {
    return boxes_.size() >= ids && (has_filter_memory_ || !filters);
  }

  /// Reserves memory for this many ids, so that functions that use these ids need not allocate. During an
  /// update, the algorithm's memory is reserved only after the update.
  void reserve(std::size_t ids, bool filters);

  void reserve_algorithm(std::size_t ids, bool filters);

  void reserve_late(std::size_t count) {
    if (is_late()) late_.reserve(count, capacity_);
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

  /// If it is late, there must be memory for that.
  void set_box(std::uint32_t id, const Aabb& packed) noexcept {
    if (is_late()) {
      late_.set(id, packed);
    } else {
      store_box(id, packed);
    }
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
    if (objects_.set_filter(id, filter)) changes_.refilter(id);
  }

  /// Stores the boxes that were set while an update was in flight.
  void apply_late();

  /// Reserves memory for the boxes of 0 .. n-1.
  void reserve_all(std::size_t n);

  /// @param arriving The boxes, all of which count as changed. Null if they are there.
  /// @param look At the boxes of map(); null for nothing.
  void begin(BoxReplacement* arriving, const LookAtBoxes* look);

  /// Makes 0 .. n-1 the ids of the objects. The memory must be reserved.
  /// @param set Called with ids, and with the boxes of those that are removed or added.
  /// @param empty Boxes of objects that are added.
  template <class SetBox>
  void set_ids(std::size_t n, const Aabb& empty, const SetBox& set) noexcept;

  /// @param mapped How many of the boxes begin() has to pack.
  /// @param empty The boxes of new objects.
  std::span<Aabb> remap(std::size_t n, std::size_t mapped, const Aabb& empty);

  /// Makes the boxes of a view those of all objects, and begins an update. If this or `end` fails, everything
  /// is as before.
  template <class Function>
  void replace_all(const BoxView& view, const Function& end);

  void swap_boxes() noexcept;

  /// Copies all boxes and begins the update. If most moved in the last one, a device receives them meanwhile.
  void copy_all(const BoxView& view);

  void replace_empty(std::span<Aabb> boxes, const Aabb& by) const noexcept;
  /// Packs the boxes that the caller wrote in place.
  /// @param look Null for nothing.
  void take_mapped(const LookAtBoxes* look);

  /// Reserves memory of the algorithm, which may store the boxes elsewhere even if that fails.
  template <class Function>
  void or_find_boxes(const Function& function);

  /// Does a part of an update. If it fails, the next update finds the changes of this one, too.
  template <class Function>
  void or_roll_back(const Function& function);

  [[noreturn]] static void throw_too_many(std::size_t objects);
  static void refuse_twice(std::span<const std::uint32_t> ids);

  /// (Memory of a device may not be there after a fork.)
  void refuse_forked() const {
    if (opencl::is_forked() && algorithm_->device() != nullptr) opencl::use_in_this_process();
  }

  /// @returns The box, or one that lives as long as the program.
  const Aabb& pack_or_refuse(const Aabb& box) {
    if (is_proper(box)) return box;
    if (has_nan(box)) throw_nan("a box");
    any_empty_ = true;
    return packed_empty_box;
  }

  AlgorithmPointer algorithm_;
  std::span<Aabb> boxes_;           // the algorithm's
  std::size_t threads_;             // that copy boxes
  bool has_filter_memory_ = false;  // in the algorithm
  std::size_t capacity_ = 0;        // ids that the following have capacity for
  ObjectTable objects_;
  std::vector<Pair> exclusions_;  // in canonical order
  std::size_t mapped_ = 0;        // boxes that the caller may have written in place
  std::size_t spare_slots_ = 0;   // from here on, the algorithm's spare boxes are packed_empty()
  bool any_empty_ = false;        // the box of some object may be packed_empty()

  ChangeSet changes_;  // since the last update began
  ChangeSet flight_;   // the changes that the update in flight applies
  Update update_ = Update::none;
  LateBoxes<Aabb> late_;    // packed
  bool many_moved_ = true;  // in the last replacement
  PairListener* listener_ = nullptr;
};

}  // namespace broadcl
