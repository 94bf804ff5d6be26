#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <ranges>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>
#include <broadcl/algorithms.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/config.hpp>
#include <broadcl/device.hpp>
#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/memory.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>
#include <broadcl/query.hpp>
#include <broadcl/state.hpp>

namespace broadcl {

namespace detail {
template <class Box>
struct TreeAccess;
}

/// Boxes in memory of a broad phase, for the caller to write: see BasicBroadPhase::map(). They may be read as
/// long as this object or a copy of it exists, even if the broad phase uses other memory by then, or is
/// destroyed.
template <class Box>
struct BasicMappedBoxes : std::span<Box> {
  std::shared_ptr<const void> owner{};  ///< Of the memory.
};

/// Holds a set of moving boxes and reports at each update() which pairs began and which ceased to overlap.
/// Programs name it BroadPhase, or BroadPhase64 for boxes in double precision.
///
/// The cost of an update depends on how much moved. If nothing moved, there is no search; if few objects
/// moved, only their boxes are uploaded and tested against all others; pairs of two objects that did not move
/// stay.
///
/// If a function throws, it has changed nothing: objects and known pairs are as before. Functions that
/// allocate may throw std::bad_alloc as well as Error.
///
/// Only one thread at a time may use an object, except for overlapping(), nearest(),
/// along() and partners(). Different objects
/// are independent of each other and may be used by different threads and use different devices. Movable, not
/// copyable; an object that was moved from may only be destroyed or assigned to.
///
/// OpenCL does not work in a process that is forked after OpenCL was used: there, functions of an object on a
/// device throw an Error, `auto` stays on the host if it is there, and objects may be destroyed. Use devices
/// only after the fork, or start processes another way.
/// @tparam Box Aabb or Aabb64. Views may have boxes in float32 or float64, whichever this is; those of
/// float64 are rounded outward for an Aabb.
template <class Box>
class BROADCL_API BasicBroadPhase {
 public:
  using Config = broadcl::Config;
  /// The type of bounds and reaches: float or double.
  using Bound = std::conditional_t<std::is_same_v<Box, Aabb64>, double, float>;

  /// Opens the device and builds the kernels, unless the algorithm starts on the host: see Config::algorithm.
  /// Objects on the same device share both, which stay until the process ends or an OpenCL call fails.
  /// @throws Error for an unknown algorithm or device, and if OpenCL fails.
  BasicBroadPhase();
  explicit BasicBroadPhase(const Config& config);
  ~BasicBroadPhase();
  BasicBroadPhase(BasicBroadPhase&&) noexcept;
  BasicBroadPhase& operator=(BasicBroadPhase&&) noexcept;

  /// Adds an object and returns its id, the lowest that is free. So ids stay dense and depend only on the
  /// sequence of calls.
  /// @param reach How far the object reaches beyond its box: see set_reach().
  /// @throws Error for a NaN bound, for a reach that set_reach() refuses, and if there is no memory for the
  /// box.
  std::uint32_t add(const Box& box, const Filter& filter = Filter(), Bound reach = 0);

  /// Adds an object for each box.
  /// @param filters As many as boxes, or one for all.
  /// @param reaches As many as boxes, one for all, or none: 0 for all.
  /// @returns The ids, in the order of the boxes: as if they were added one after the other.
  /// @throws Error as above; then none was added.
  std::vector<std::uint32_t> add(const BoxView& boxes, std::span<const Filter> filters,
                                 std::span<const Bound> reaches = {});
  std::vector<std::uint32_t> add(const BoxView& boxes, const Filter& filter = Filter());

  /// Replaces the box of an object. A box that is equal to the old one does not count as movement.
  /// @throws Error for an unknown id and for a NaN bound.
  void move(std::uint32_t id, const Box& box);

  /// Replaces the boxes of some objects, by several threads if there are many and the ids ascend. If an id is
  /// given twice, the later box counts.
  /// @param ids As many as boxes.
  /// @throws Error as above; then none was replaced.
  void move(std::span<const std::uint32_t> ids, const BoxView& boxes);

  /// Replaces the filter of an object. From the next update on, it has the pairs that the new filter allows.
  /// @throws Error for an unknown id, and if there is no memory for filters.
  void set_filter(std::uint32_t id, const Filter& filter);

  /// Replaces the filters of some objects.
  /// @param filters As many as ids, or one for all. If an id is given twice, the later one counts.
  /// @throws Error as above; then none was replaced.
  void set_filters(std::span<const std::uint32_t> ids, std::span<const Filter> filters);

  /// Sets how far some objects reach beyond their boxes. Two objects pair if the distance of their boxes is
  /// at most the sum of their reaches. Spheres and particles are points with a reach. A reach that changes
  /// counts as movement; box() returns the box all the same. With a sum of 0, or below 2^-63, boxes have to
  /// overlap.
  ///
  /// The distance is Euclidean. Along each axis, the gap is lower bound minus upper bound if that is at least
  /// 2^-63, otherwise 0; the squares of the three gaps are added in the order of the axes, and the sum is
  /// compared with the square of the sum of the reaches, each step rounded to the nearest number of the type
  /// of the bounds. So results are the same on every device.
  /// @param reaches As many as ids, or one for all. If an id is given twice, the later one counts.
  /// @throws Error for an unknown id, for a reach that is negative, NaN or greater than 2^62, and if there is
  /// a Config::distance; then none was set.
  void set_reach(std::span<const std::uint32_t> ids, std::span<const Bound> reaches);

  /// Replaces the list of pairs of ids that are never reported, whatever their boxes and filters: for
  /// instance joined bodies, or edges that share a vertex (pairs_that_share()). A pair applies to whichever
  /// objects have the two ids. Initially the list is empty.
  /// @param pairs In any order; copied.
  /// @throws Error for a pair of an id with itself.
  void set_exclusions(std::span<const Pair> pairs);

  /// Removes an object; its id may be given to the next one added. Its pairs appear in `removed` of the next
  /// update.
  /// @throws Error for an unknown id.
  void remove(std::uint32_t id);
  /// Removes some objects.
  /// @throws Error for an unknown id, and for one that is given twice; then none was removed.
  void remove(std::span<const std::uint32_t> ids);

  /// Whether an object has this id.
  [[nodiscard]] bool contains(std::uint32_t id) const noexcept;
  /// The box of an object, as it will be in the next update. (An empty one may have other bounds than those
  /// that were given.)
  /// @throws Error for an unknown id.
  [[nodiscard]] Box box(std::uint32_t id) const;
  /// Its filter.
  /// @throws Error for an unknown id.
  [[nodiscard]] Filter filter(std::uint32_t id) const;
  /// Its reach; with a Config::distance, half of that.
  /// @throws Error for an unknown id.
  [[nodiscard]] Bound reach(std::uint32_t id) const;

  /// The ids of all objects, in ascending order.
  [[nodiscard]] std::vector<std::uint32_t> ids() const;
  /// The boxes of all objects, in the order of ids(), each as box() returns it.
  [[nodiscard]] std::vector<Box> boxes() const;
  /// Their filters, in the same order.
  [[nodiscard]] std::vector<Filter> filters() const;
  /// Their reaches, in the same order.
  [[nodiscard]] std::vector<Bound> reaches() const;
  /// What set_exclusions() was given last, in canonical order and each pair once.
  [[nodiscard]] std::vector<Pair> exclusions() const;

  /// For callers who compute all boxes in place. Makes 0 .. n-1 the ids of the objects, by adding those that
  /// are missing and removing all others, and returns the memory from which the device (in a BroadPhase64,
  /// the next update) reads their boxes, for the caller to write. New objects have empty boxes until then.
  /// All objects count as moved.
  /// @returns n boxes, which may be written until the next call of a function of this object that is not
  /// const. If one of them has a NaN bound, the next update() or begin() throws an Error that names the first
  /// such box, and changes nothing; the boxes may still be written: write one without NaN, and call it again.
  /// @throws Error between begin() and finish(), and if there is no memory for the boxes.
  BasicMappedBoxes<Box> map(std::size_t n);

  /// Finds every pair of overlapping boxes whose filters allow it, and returns what changed since the last
  /// update. The same as begin() and finish().
  /// @throws Error if the device fails or its memory is exhausted, and for a NaN that was written to the
  /// memory of map(). The call may be repeated.
  Delta update();

  /// The same with new boxes for all objects: box k becomes that of object k, missing objects are added, and
  /// objects beyond the last box are removed. The ids are then 0 .. n-1; objects that existed keep their
  /// filters. The boxes are in memory of the caller, in any layout. Each box is read once, by several threads
  /// if there are many, while a device receives those before. Boxes that are the same as before do not count
  /// as movement.
  /// @throws Error for a NaN bound (it names the first such box), between begin() and finish(), and as
  /// update() does. Objects, boxes and pairs are then as before the call, which may be repeated.
  Delta update(const BoxView& boxes);

  /// Starts an update on the device and returns at once. Until finish(), the thread is free, and objects may
  /// be added, moved, removed and filtered; these changes belong to the next update. No-op if an update was
  /// started already. If the host does the update, finish() does all of the work, so nothing is gained.
  ///
  /// Does not wait for the device, unless memory must grow for objects that were added during the last
  /// update.
  /// @throws Error as update() does.
  void begin();

  /// The same with new boxes for all objects, of which those beyond the last box are removed: see update().
  /// The memory of the boxes may be overwritten when this returns.
  /// @throws Error as update() does, also if an update was started already. Objects and boxes are then as
  /// before.
  void begin(const BoxView& boxes);

  /// Waits for the update that begin() started, or does one if none was started, and returns the changes, for
  /// the state of the objects at begin().
  /// @throws Error as update() does. The update that was started is then over, and the next one finds its
  /// changes, too.
  Delta finish();

  /// Copies the objects for restore(). Nothing is searched. From the first call on, up to two bytes for each
  /// id say which boxes changed since, so that restore() compares no others.
  /// @throws Error between begin() and finish(), and with changes that no update has reported.
  [[nodiscard]] BasicState<Box> save() const;

  /// Makes objects, ids, filters, reaches, exclusions and pairs those of the moment of save(), and drops
  /// changes that no update has reported. Results are then those of an object that never went on. The cost
  /// depends on what differs, as in update(boxes). The state may be that of another object of this type, with
  /// any algorithm, device and number of threads, and the same Config::distance.
  /// @returns What changed since the last update, to be applied or dropped. A pair that is there before and
  /// afterwards is not in it, even if its objects were replaced meanwhile.
  /// @throws Error between begin() and finish(), for another Config::distance, and as update() does. Nothing
  /// has changed then, and the call may be repeated.
  Delta restore(const BasicState<Box>& state);

  /// Gives back memory that the present objects and pairs do not need, on host and device, for instance after
  /// an update with far more pairs than usual; nothing does so by itself. Objects, ids and pairs stay as they
  /// are. The lists of the last update become invalid, unless their Delta exists; profile() then returns
  /// nothing. The next updates take longer, until memory has grown again. Waits for the device.
  /// @throws Error between begin() and finish(), and if the device fails or has too little memory for a
  /// moment, since what is needed is copied.
  void shrink();

  /// All pairs as of the last update, in canonical order.
  /// @throws Error between begin() and finish(), and if the device fails.
  [[nodiscard]] std::vector<Pair> pairs() const;

  /// The ids of the objects that are in a pair with this one, as of the last update, in ascending order. The
  /// first call after an update passes once over the pairs and keeps 12 bytes for each of them, until
  /// shrink(); further ones take as long as there are partners.
  /// @throws Error for an unknown id, between begin() and finish(), and if the device fails.
  [[nodiscard]] std::vector<std::uint32_t> partners(std::uint32_t id) const;

  /// The objects that overlap or touch some boxes, or are near them (QueryOptions::within): as their boxes
  /// are set now, also between begin() and finish(). No update is needed before, and none is done. A point is
  /// a box of no size. An empty box finds nothing, and empty objects are never found. An object finds itself
  /// if it asks with its own box, unless it is excepted. Exclusions do not matter.
  ///
  /// The host does this, whatever does the updates, with the tree that its own updates use. The first queries
  /// after a change test what changed one by one; when that has taken as long as putting it into the tree,
  /// that is done, and the next update need not do it again. An object on a device keeps a tree for queries
  /// on the host from the first one on, until shrink().
  ///
  /// Several threads may call this at the same time, as long as nobody calls a function that is not const.
  /// @throws Error for a NaN bound (it names the first such box), for as many filters or exceptions as there
  /// must not be, for a distance that is negative, NaN or greater than 2^62, and if there are more than
  /// `most_hits`; std::bad_alloc.
  [[nodiscard]] Hits overlapping(const BoxView& boxes, const QueryOptions& options = QueryOptions()) const;

  /// The same for a single box.
  /// @param ids Receives what it finds, in ascending order, in place of what it had; so its memory is used
  /// again. Empty if only the number is wanted.
  /// @returns How many it finds.
  std::size_t overlapping(const Box& box, std::vector<std::uint32_t>& ids,
                          const QueryOptions& options = QueryOptions()) const;

  /// The objects that are nearest to some boxes: of each query the `limit` ones with the least distance, and
  /// of those at the same distance the ones with the lowest ids, in this order. Without a limit, all that are
  /// at most QueryOptions::within away. Distances are those that set_reach() defines, squared, of the boxes
  /// themselves: reaches do not matter. What overlaps the query is at distance 0, and so is what it misses by
  /// less than 2^-63; that is not found if `within` is less. Otherwise as overlapping().
  [[nodiscard]] Hits nearest(const BoxView& boxes, const QueryOptions& options = QueryOptions()) const;

  /// The objects that some boxes meet on their way, in the order in which they do, and by id if at the same
  /// time: of each query the first `limit` ones. A ray is a box of no size. Reaches do not matter. Otherwise
  /// as overlapping().
  ///
  /// A box moves from its start by t times its direction, for all t from 0 to its length. It meets an object
  /// if along each axis it is not beyond it yet, and not past it, at the same t; the first one is its time.
  /// Along an axis on which it moves, that is for t from (l - b) r to (u - a) r, or the other way round if it
  /// moves down, where [a, b] is the interval of the start, [l, u] that of the object, and r = 1 / component
  /// of the direction; each operation is rounded to the nearest number, in the precision of the bounds. Along
  /// the others, that is always if the intervals share a number, and otherwise never. A component whose
  /// reciprocal is infinite counts as 0. So what is met at the start has the time 0; along a face or an edge
  /// that is parallel to an axis, a ray meets the box; and rounding decides where it passes an edge at an
  /// angle. What is at infinity is met at an infinite time.
  /// @param starts Finite, or empty: those meet nothing.
  /// @param directions One for each start, or one for all. Finite, of any length; with 0, objects are found
  /// that the start overlaps.
  /// @param lengths In multiples of the directions, one for each start, one for all, or none: infinite.
  /// Infinity is allowed.
  /// @throws Error as overlapping(), for an infinite start, for a direction that is infinite or NaN, for a
  /// length that is negative or NaN, and if QueryOptions::within is given.
  [[nodiscard]] Hits along(const BoxView& starts, std::span<const std::array<Bound, 3>> directions,
                           std::span<const Bound> lengths = {},
                           const QueryOptions& options = QueryOptions()) const;

  /// Number of objects.
  [[nodiscard]] std::size_t size() const noexcept;

  /// The device that will do the next update; null for the host. Valid until the next call of a
  /// function that is not const.
  [[nodiscard]] const Device* device() const noexcept;

  /// The algorithm in use.
  [[nodiscard]] const AlgorithmInfo& algorithm() const noexcept;

  /// OpenCL memory in use; all 0 if no device was opened. Buffers grow with boxes and pairs; most shrink only
  /// by shrink().
  [[nodiscard]] MemoryUse memory() const noexcept;

  /// The stages of the last update, in order; none if nothing had moved, or if an algorithm of the host did
  /// it. Valid until the next update. (In a BroadPhase64, `touching` finds the pairs that are compared in
  /// float64; gpu-bf does this on the host, as a part of no stage.)
  [[nodiscard]] std::span<const Stage> profile() const noexcept;

 private:
  friend struct detail::TreeAccess<Box>;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A broad phase whose boxes are in single precision.
using BroadPhase = BasicBroadPhase<Aabb>;
/// Boxes in memory of a BroadPhase, for the caller to write.
using MappedBoxes = BasicMappedBoxes<Aabb>;

extern template class BROADCL_API BasicBroadPhase<Aabb>;

/// All pairs of objects that have a label in common, in canonical order, for BroadPhase::set_exclusions(). If
/// the objects are the edges or faces of a mesh, their labels are the numbers of their vertices. Any number
/// of threads may call this at the same time.
/// @param labels `per_object` labels of object 0, then as many of object 1, and so on.
/// @throws Error if the number of labels is not a multiple of `per_object`; std::bad_alloc.
[[nodiscard]] BROADCL_API std::vector<Pair> pairs_that_share(std::span<const std::uint32_t> labels,
                                                             std::size_t per_object);

/// All pairs of an object of one set and an object of another that have a label in common, in canonical
/// order, for overlapping_pairs(). If the sets are the faces and the vertices of a mesh, a face has three
/// labels and a vertex has one, its number. Otherwise as with one set.
[[nodiscard]] BROADCL_API std::vector<Pair> pairs_that_share(std::span<const std::uint32_t> first_labels,
                                                             std::size_t per_first,
                                                             std::span<const std::uint32_t> second_labels,
                                                             std::size_t per_second);

/// All overlapping pairs of boxes in the caller's memory, in any layout, by index, in canonical order. The
/// boxes are not stored. Boxes in float64 have exactly the pairs that overlap or touch as float64: they are
/// searched as float32, as by a BroadPhase64, and pairs that touch there are compared in float64. Their
/// memory must not change during the call. By default the host does the search, unless a CPU is named as the
/// device. A device stays open for later calls, but its memory is freed, so for frequent searches keep a
/// BroadPhase.
/// Any number of threads may call this at the same time, also with the same boxes.
/// @param exclusions Pairs of indices that are not reported, in any order: see BroadPhase::set_exclusions().
/// @throws Error for a NaN bound (it names the first such box), for an exclusion of a box and itself or of a
/// box that does not exist, for more than 2^31 pairs (of float64 boxes, also if they overlap as float32
/// only), and as BroadPhase does; std::bad_alloc.
[[nodiscard]] BROADCL_API std::vector<Pair> overlapping_pairs(
    const BoxView& boxes, std::span<const Pair> exclusions = {},
    const BroadPhase::Config& config = BroadPhase::Config());

/// All overlapping pairs of a box of one set and a box of another: `a` is an index in `first`, `b` in
/// `second`. Nothing is tested inside a set. (For two sets that move, keep a BroadPhase with the filters
/// Filter::first_set and Filter::second_set.)
/// @param exclusions Pairs that are not reported, in any order: `a` is an index in `first`, `b` in `second`.
/// @returns Pairs in canonical order: by b, then by a; a may be greater than b.
/// @throws Error for a NaN bound (it names the first such box), for an exclusion of a box that does not
/// exist, for more than 2^31 boxes together, and as BroadPhase does; std::bad_alloc.
[[nodiscard]] BROADCL_API std::vector<Pair> overlapping_pairs(
    const BoxView& first, const BoxView& second, std::span<const Pair> exclusions = {},
    const BroadPhase::Config& config = BroadPhase::Config());

/// Of each query the boxes that it finds, by index: as BasicBroadPhase::overlapping() of a broad phase that
/// has these boxes. For frequent queries, keep a BroadPhase, which keeps the tree. Any number of threads may
/// call this at the same time.
/// @param boxes, queries Boxes in float64, in one of the two, are compared as float64.
/// @throws Error for a NaN bound (it names the first such box), and as BasicBroadPhase::overlapping() does.
[[nodiscard]] BROADCL_API Hits overlapping(const BoxView& boxes, const BoxView& queries,
                                           const QueryOptions& options = QueryOptions(),
                                           const BroadPhase::Config& config = BroadPhase::Config());

/// Of each query the boxes that are nearest to it, by index: as BasicBroadPhase::nearest(), and otherwise as
/// overlapping().
[[nodiscard]] BROADCL_API Hits nearest(const BoxView& boxes, const BoxView& queries,
                                       const QueryOptions& options = QueryOptions(),
                                       const BroadPhase::Config& config = BroadPhase::Config());

/// Of each query the boxes that it meets on its way, by index: as BasicBroadPhase::along(), and otherwise as
/// overlapping(). Directions and lengths are rounded to float32 unless boxes are compared as float64.
[[nodiscard]] BROADCL_API Hits along(const BoxView& boxes, const BoxView& starts,
                                     std::span<const std::array<double, 3>> directions,
                                     std::span<const double> lengths = {},
                                     const QueryOptions& options = QueryOptions(),
                                     const BroadPhase::Config& config = BroadPhase::Config());

/// The squares of the distances of pairs of boxes, as BasicBroadPhase::set_reach() defines them: of float64
/// boxes in float64, otherwise in float32. Infinite if a box is empty or has a NaN.
/// @param pairs By index.
/// @param config Of which only the threads matter.
/// @throws Error for an index of no box; std::bad_alloc.
[[nodiscard]] BROADCL_API std::vector<double> squared_distances(
    const BoxView& boxes, std::span<const Pair> pairs,
    const BroadPhase::Config& config = BroadPhase::Config());
/// The same for pairs of a box of one set and a box of another.
[[nodiscard]] BROADCL_API std::vector<double> squared_distances(
    const BoxView& first, const BoxView& second, std::span<const Pair> pairs,
    const BroadPhase::Config& config = BroadPhase::Config());

/// overlapping_pairs() of one set in any other range of boxes, including a temporary one. Boxes that no
/// BoxView can view are copied.
template <AabbRange Range>
[[nodiscard]] std::vector<Pair> overlapping_pairs(Range&& boxes, std::span<const Pair> exclusions = {},
                                                  const BroadPhase::Config& config = BroadPhase::Config()) {
  if constexpr (AabbArray<Range&>) {
    return overlapping_pairs(BoxView(boxes), exclusions, config);
  } else {
    std::vector<Aabb> copy;
    if constexpr (std::ranges::sized_range<Range>) copy.reserve(std::ranges::size(boxes));
    for (auto&& box : boxes) copy.push_back(std::forward<decltype(box)>(box));
    return overlapping_pairs(copy, exclusions, config);
  }
}

}  // namespace broadcl

#endif
