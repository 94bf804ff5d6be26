#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

#include "base/box_replacement.hpp"
#include "base/kept_boxes.hpp"
#include "base/packed_box.hpp"
#include "base/threads.hpp"
#include "core/change_set.hpp"
#include "core/converted_boxes.hpp"
#include "core/exact_pairs.hpp"
#include "core/exact_reaches.hpp"
#include "core/late_boxes.hpp"
#include "core/object_table.hpp"
#include "core/recorder.hpp"
#include "core/state.hpp"
#include "core/timeline.hpp"
#include "engines/algorithm.hpp"
#include "engines/box_tree.hpp"
#include "opencl/process.hpp"

namespace broadcl {

/// Called for the boxes from `begin` to `end`, one of the parts of for_each_part(), by one of several
/// threads.
template <class Box>
using LookAtBoxes = std::function<void(std::size_t begin, std::size_t end, std::span<const Box> boxes)>;

/// What a core in double precision has beside its algorithm.
struct ExactParts {
  explicit ExactParts(const Threads& threads) : converted(threads), reaches(threads), pairs(threads) {}

  KeptBoxes<Aabb64> boxes;
  ConvertedBoxes converted;
  ExactReaches reaches;
  ExactPairs pairs;
};
struct NoExactParts {
  explicit NoExactParts(const Threads& /*threads*/) noexcept {}
};

/// Objects, their ids, and what changed. Each function first does everything that may throw; a comment
/// marks where the rest begins, which cannot throw. So a function that throws has changed nothing.
/// @tparam Box Aabb, or Aabb64: then the algorithm gets boxes as float32 that overlap if these do, and those
/// of its pairs are left out that do not overlap.
template <class Box>
class Core {
 public:
  using Bound = BoundType<Box>;

  /// @param threads That copy boxes, at most; 0 for one per processor.
  /// @param reach Of all objects; if it is 0, each may have its own.
  explicit Core(AlgorithmPointer algorithm, const Threads& threads = 0, Bound reach = 0)
      : algorithm_(std::move(algorithm)),
        exact_(threads),
        boxes_(find_boxes()),
        threads_(threads),
        objects_(reach) {}

  /// @param recorder Gets the objects of each update, before it is done; null for none.
  void record_to(std::unique_ptr<Recorder<Box>> recorder) noexcept { recorder_ = std::move(recorder); }

  std::uint32_t add(const Box& box, const Filter& filter, Bound reach = 0) {
    refuse_forked();
    if (reach != 0) refuse_reaches({&reach, 1}, 1);
    const Box& packed = pack_or_refuse(box);
    reserve(std::max<std::size_t>(objects_.ids(), std::size_t{objects_.next()} + 1), filter != Filter(),
            reach > 0);
    reserve_late(1);
    // Nothing below throws.
    return add_packed(packed, filter, reach);
  }

  /// @param filters One for all boxes, or as many as boxes.
  /// @param reaches The same, or none.
  std::vector<std::uint32_t> add(const BoxView& boxes, std::span<const Filter> filters,
                                 std::span<const Bound> reaches = {});

  void move(std::uint32_t id, const Box& box) {
    refuse_forked();
    objects_.refuse_unknown(id);
    const Box& packed = pack_or_refuse(box);
    reserve_late(1);
    // Nothing below throws.
    set_box(id, packed);
  }

  void move(std::span<const std::uint32_t> ids, const BoxView& boxes);

  void set_filter(std::uint32_t id, const Filter& filter) { set_filters({&id, 1}, {&filter, 1}); }
  /// @param filters As many as ids, or one for all.
  void set_filters(std::span<const std::uint32_t> ids, std::span<const Filter> filters);
  void set_reach(std::span<const std::uint32_t> ids, std::span<const Bound> reaches);
  void set_exclusions(std::span<const Pair> pairs);

  void remove(std::uint32_t id) { remove({&id, 1}); }
  void remove(std::span<const std::uint32_t> ids);

  [[nodiscard]] bool contains(std::uint32_t id) const noexcept { return objects_.contains(id); }

  [[nodiscard]] Box box(std::uint32_t id) const;
  [[nodiscard]] const Filter& filter(std::uint32_t id) const;
  [[nodiscard]] Bound reach(std::uint32_t id) const;
  /// Of all objects, ascending.
  [[nodiscard]] std::vector<std::uint32_t> ids() const;
  /// In canonical order.
  [[nodiscard]] std::span<const Pair> exclusions() const noexcept { return *exclusions_; }
  /// By id; none if all objects that ever were had the default filter.
  [[nodiscard]] std::span<const Filter> filters() const noexcept { return objects_.filters(); }
  [[nodiscard]] std::span<const Bound> reaches() const noexcept { return objects_.reaches(); }
  /// The box of an id as it is set now; if no object has it, packed_empty().
  [[nodiscard]] Box packed_box(std::uint32_t id) const noexcept {
    const Box* const late = late_.empty() ? nullptr : late_.find(id);
    if (late == nullptr && id >= boxes_.size())
      return packed_empty_box;                          // free, after a shrink() that failed
    return pack(late != nullptr ? *late : boxes_[id]);  // those that were in map() may not be packed
  }
  /// No object has this id or a higher one. (Only one thread at a time may ask.)
  [[nodiscard]] std::size_t slots() noexcept { return objects_.slots(); }
  /// The box of the algorithm that a box would become.
  [[nodiscard]] Aabb image_of(const Box& box) const noexcept {
    if constexpr (is_exact) {
      return exact_.converted.image_of(box);
    } else {
      return box;
    }
  }

  /// How boxes were converted; null if they were not.
  [[nodiscard]] const CoordinateMap* map_of_boxes() const noexcept {
    if constexpr (is_exact) {
      return &exact_.converted.map();
    } else {
      return nullptr;
    }
  }

  /// Chooses the tree of queries: that of the algorithm, or else one of its own.
  /// @throws std::bad_alloc
  [[nodiscard]] BoxTree& choose_tree();
  /// The ids whose boxes or rules may not be those in that tree, ascending; none if all may be others.
  /// @throws std::bad_alloc
  [[nodiscard]] std::optional<std::vector<std::uint32_t>> unread() const;
  /// How many these are, or more.
  [[nodiscard]] std::size_t count_unread() noexcept;
  /// Adds the objects as they are set now to an empty core, under the same ids. (Those that do not exist have
  /// empty boxes.)
  /// @param slots As slots() returned.
  /// @throws std::bad_alloc
  void copy_to(Core& core, std::size_t slots) const;
  /// Whether read() can put these into that tree now.
  [[nodiscard]] bool can_read() const noexcept { return mapped_ == 0 && late_.empty() && !is_begun(); }
  /// The next update need not do so again.
  /// @throws std::bad_alloc
  void read();

  /// (Memory of a device may not be there after a fork.)
  void refuse_forked() const {
    if (opencl::is_forked() && algorithm_->device() != nullptr) opencl::use_in_this_process();
  }
  /// Of the update that was begun, packed, by id; empty for ids that are free.
  [[nodiscard]] std::span<const Box> boxes() const noexcept { return boxes_.first(objects_.ids()); }

  std::span<Box> map(std::size_t n);
  /// Of the memory that map() returned.
  [[nodiscard]] std::shared_ptr<const void> boxes_owner() const;
  /// What map() throws for this number of boxes before it does anything.
  void refuse_replacement(std::size_t boxes) const;

  void begin() { begin(nullptr, nullptr); }
  /// @param look Called for each part of the boxes of map() when begin() has just read them, so that they
  /// need not be read from memory twice. Boxes that are empty or have a NaN are still as the caller wrote
  /// them.
  /// @throws What `look` throws; there is no update then.
  void begin(const LookAtBoxes<Box>& look) { begin(nullptr, &look); }
  void begin(const BoxView& boxes);
  void flush();
  Delta finish();
  Delta update(const BoxView& boxes);

  /// What restore() needs to return to the last update.
  [[nodiscard]] std::shared_ptr<const Saved<Box>> save();
  Delta restore(const Saved<Box>& saved);

  /// Gives back memory that the present objects and pairs do not need.
  void shrink();

  [[nodiscard]] std::vector<Pair> pairs() const;

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

  static constexpr auto infinity = std::numeric_limits<Bound>::infinity();
  static constexpr bool is_exact = std::is_same_v<Box, Aabb64>;
  static constexpr Box packed_empty_box = packed_empty<Box>();
  static constexpr Box empty_box{{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}};
  static constexpr std::size_t least_capacity = 16;  // so that the first objects do not each allocate

  /// Whether the algorithm has memory for this many boxes, and for filters if there are any.
  [[nodiscard]] bool has_memory_for(std::size_t ids, bool filters) const noexcept {
    return boxes_.size() >= ids && (has_filter_memory_ || !filters);
  }

  /// Reserves memory for this many ids, so that functions that use these ids need not allocate. During an
  /// update, the algorithm's memory is reserved only after the update.
  void reserve(std::size_t ids, bool filters, bool reaches = false);

  void reserve_algorithm(std::size_t ids, bool filters);

  void reserve_late(std::size_t count) {
    if (is_late()) late_.reserve(count, capacity_);
  }

  std::uint32_t add_packed(const Box& packed, const Filter& filter, Bound reach) noexcept {
    const std::uint32_t id = objects_.add();
    changes_.recycle(id);
    set_box(id, packed);
    store_filter(id, filter);
    store_reach(id, objects_.first_reach() + reach);  // one of the two is 0
    return id;
  }

  /// Whether a box that is set now has to be stored later, because the algorithm is reading its boxes, or
  /// because earlier boxes are still waiting.
  [[nodiscard]] bool is_late() const noexcept { return is_in_flight() || !late_.empty(); }

  [[nodiscard]] bool is_in_flight() const noexcept { return update_ == Update::in_flight; }
  [[nodiscard]] bool is_begun() const noexcept { return update_ == Update::begun || is_in_flight(); }

  /// If it is late, there must be memory for that.
  void set_box(std::uint32_t id, const Box& packed) noexcept {
    if (is_late()) {
      late_.set(id, packed);
    } else {
      store_box(id, packed);
    }
  }

  void store_box(std::uint32_t id, const Box& packed) noexcept {
    // Among boxes that the caller writes in place, a NaN would be the caller's.
    const Box& box = id < mapped_ && !is_proper(packed) ? empty_box : packed;
    Box& old = boxes_[id];
    if (same_bits(old, box)) return;
    old = box;
    changes_.insert(id);
  }

  void store_filter(std::uint32_t id, const Filter& filter) noexcept {
    if (objects_.set_filter(id, filter)) changes_.refilter(id);
  }

  template <class Function>
  [[nodiscard]] bool for_each_unread(const Function& function) const;
  void convert_changed(bool are_converted);
  [[nodiscard]] PairRules rules() const;
  /// To be called when an update is over: the algorithm's tree has read all of it.
  void forget_unread() noexcept {
    if (!own_tree_) unread_.clear();
    unread_slots_.reset();
  }

  void store_reach(std::uint32_t id, Bound reach) noexcept {
    if (objects_.set_reach(id, reach)) changes_.insert(id);
  }

  /// Those of the algorithm's boxes, by slot.
  [[nodiscard]] std::span<const float> reaches_of_images() const noexcept {
    if constexpr (is_exact) {
      return exact_.reaches.of_images();
    } else {
      return objects_.reaches();
    }
  }

  /// @throws Error unless there is one for all objects, or one for each, and all of them are valid.
  void refuse_reaches(std::span<const Bound> reaches, std::size_t objects) const;

  /// Stores the boxes that were set while an update was in flight.
  void apply_late();

  /// Reserves memory for the boxes of 0 .. n-1.
  void reserve_all(std::size_t n);

  /// @param arriving The boxes, all of which count as changed. Null if they are there.
  /// @param look At the boxes of map(); null for nothing.
  /// @param are_converted Whether the algorithm has the boxes, too.
  void begin(ArrivingBoxes* arriving, const LookAtBoxes<Box>* look, bool are_converted = false);

  /// Makes 0 .. n-1 the ids of the objects. The memory must be reserved.
  /// @param set Called with ids, and with the boxes of those that are removed or added.
  /// @param empty Boxes of objects that are added.
  template <class SetBox>
  void set_ids(std::size_t n, const Box& empty, const SetBox& set) noexcept;

  /// Makes the boxes of a view those of all objects, and begins an update. If this or `end` fails, everything
  /// is as before.
  /// @param saved The objects whose boxes they are; null for 0 .. n-1.
  template <class Function>
  void replace_all(const BoxView& view, const Saved<Box>* saved, const Function& end);
  /// Moves those that differ, unless they are many.
  /// @returns Whether it did.
  template <class Function>
  bool replace_few(const BoxView& view, const Saved<Box>* saved, const Function& end);
  /// The slots whose boxes may differ from those that were saved, ascending; none if these may be many.
  [[nodiscard]] std::optional<std::vector<std::uint32_t>> changed_since(const Saved<Box>& saved);
  /// Copies them all.
  /// @param same_objects Whether the objects stay.
  template <class Function>
  void replace_many(const BoxView& view, const Saved<Box>* saved, bool same_objects, const Function& end);

  [[nodiscard]] bool has_objects(const Saved<Box>& saved) noexcept;
  void set_objects(const Saved<Box>& saved);
  void share_exclusions(const SharedPairs& pairs);

  void swap_boxes() noexcept;

  void record() noexcept {
    if (recorder_) recorder_->write(objects_, boxes_, {&changes_, &read_, &flight_}, *exclusions_);
  }

  /// Copies all boxes and begins the update. If most moved in the last one, a device receives them meanwhile.
  /// @param sets_ids Whether 0 .. n-1 become the ids.
  void copy_all(const BoxView& view, bool sets_ids);

  void replace_empty(std::span<Box> boxes, const Box& by) const noexcept;
  /// Packs the boxes that the caller wrote in place.
  /// @param look Null for nothing.
  void take_mapped(const LookAtBoxes<Box>* look);

  /// The caller's boxes, as many as the algorithm has memory for.
  [[nodiscard]] std::span<Box> find_boxes() noexcept;
  /// Memory for as many others.
  /// @throws As Algorithm::spare_boxes().
  [[nodiscard]] std::span<Box> find_spare();

  /// Reserves memory of the algorithm, which may store the boxes elsewhere even if that fails.
  template <class Function>
  void or_find_boxes(const Function& function) {
    try {
      function();
    } catch (...) {
      boxes_ = find_boxes();
      throw;
    }
  }

  /// Does a part of an update. If it fails, the next update finds the changes of this one, too.
  template <class Function>
  void or_roll_back(const Function& function);

  /// @returns The box, or one that lives as long as the program.
  const Box& pack_or_refuse(const Box& box) {
    if (is_proper(box)) return box;
    if (has_nan(box)) throw_nan("a box");
    any_empty_ = true;
    return packed_empty_box;
  }

  AlgorithmPointer algorithm_;
  [[no_unique_address]] std::conditional_t<is_exact, ExactParts, NoExactParts> exact_;
  std::span<Box> boxes_;            // the algorithm's, or those of `exact_`
  Threads threads_;                 // that copy boxes
  bool has_filter_memory_ = false;  // in the algorithm
  std::size_t capacity_ = 0;        // ids that the following have capacity for
  ObjectTable<Bound> objects_;
  SharedPairs exclusions_ = std::make_shared<const std::vector<Pair>>();  // in canonical order
  std::size_t mapped_ = 0;       // boxes that the caller may have written in place
  std::size_t spare_slots_ = 0;  // from here on, spare boxes are packed_empty()
  bool any_empty_ = false;       // the box of some object may be packed_empty()

  ChangeSet changes_;  // since the last update began, except those in read_
  ChangeSet read_;     // those that read() has read
  ChangeSet unread_;   // earlier ones that the own tree has not read; without one, of the update in flight
  std::optional<SlotChanges> unread_slots_;  // the same of the update in flight, if some were read
  std::unique_ptr<BoxTree> own_tree_;        // for queries, if the algorithm has none
  ChangeSet flight_;                         // the changes that the update in flight applies
  Timeline timeline_;                        // without changes_ and read_
  Update update_ = Update::none;
  LateBoxes<Box> late_;     // packed
  bool many_moved_ = true;  // in the last replacement
  std::unique_ptr<Recorder<Box>> recorder_;
};

extern template class BROADCL_API Core<Aabb>;  // for libbroadcl_mpi
extern template class Core<Aabb64>;

}  // namespace broadcl
