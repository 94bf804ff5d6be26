#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <ranges>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/config.hpp>
#include <broadcl/device.hpp>
#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/memory.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

namespace broadcl {

namespace mpi {
class Region;
}

/// Holds a set of moving boxes and reports at each update() which pairs began and which ceased to overlap.
///
/// An update costs as much as what moved: if nothing did, the device is not asked; if little did, only that
/// is uploaded and tested against all; pairs of two objects that did not move stay.
///
/// Every function does all of its work or none: if it throws, objects and known pairs are as before. Besides
/// Error, functions that allocate throw std::bad_alloc.
///
/// Not synchronised: one thread at a time may use an object. Different objects are independent of each other
/// and may live on different threads and on different devices. Can be moved, not copied; an object that was
/// moved from may only be destroyed or assigned to.
class BROADCL_API BroadPhase {
 public:
  using Config = broadcl::Config;

  /// Opens the device and builds the kernels, unless it works on the host at first: see Config::algorithm.
  /// @throws Error for an unknown algorithm or device, and for whatever fails in OpenCL.
  BroadPhase();
  explicit BroadPhase(const Config& config);
  ~BroadPhase();
  BroadPhase(BroadPhase&&) noexcept;
  BroadPhase& operator=(BroadPhase&&) noexcept;

  /// Adds an object and returns its id: the lowest that is free, so that ids stay dense and depend on the
  /// sequence of calls only.
  /// @throws Error for a NaN bound, and if there is no memory for the box.
  std::uint32_t add(const Aabb& box, const Filter& filter = Filter());

  /// Replaces the box of an object. A box that is equal to the old one does not count as movement.
  /// @throws Error for an unknown id and for a NaN bound.
  void move(std::uint32_t id, const Aabb& box);

  /// Replaces the filter of an object: from the next update on its pairs are those that the new one allows.
  /// @throws Error for an unknown id, and if there is no memory for filters.
  void set_filter(std::uint32_t id, const Filter& filter);

  /// Replaces the list of pairs of ids that are never reported, whatever their boxes and filters: of joined
  /// bodies, for instance, or of edges that share a vertex (pairs_that_share()). Each holds for whichever
  /// objects have the ids. At first there are none.
  /// @param pairs In any order; copied.
  /// @throws Error for a pair of an id with itself.
  void set_exclusions(std::span<const Pair> pairs);

  /// Removes an object; its id may be given to the next one added. Its pairs appear in `removed` of the next
  /// update.
  /// @throws Error for an unknown id.
  void remove(std::uint32_t id);

  /// For callers whose boxes all move, or are stored elsewhere: makes 0 .. n-1 the ids of the objects, adding
  /// those that are missing and removing those beyond, and returns the memory that the device reads their
  /// boxes from, to be written in place. New objects have empty boxes until then. All of them count as moved.
  /// @returns n boxes, valid until the next call of any other function of this object. A NaN bound among them
  /// is an error of the next update() or begin(), which names the first and changes nothing; write a proper
  /// box and call it again.
  /// @throws Error while an update that begin() started is not finished, and if there is no memory for the
  /// boxes.
  std::span<Aabb> map(std::size_t n);

  /// Keeps the memory that map() just returned from being freed, even if it moves or this object is
  /// destroyed, for callers who cannot know when somebody looks at it last. It may be read then, but not
  /// written.
  [[nodiscard]] std::shared_ptr<const void> mapped_memory() const;

  /// Finds every pair of overlapping boxes that their filters let pair, and returns what changed since the
  /// last update. The same as begin() and finish().
  /// @throws Error if the device fails or its memory is exhausted, and for a NaN that was written to the
  /// memory of map(); the call may be repeated.
  Delta update();

  /// Starts an update on the device and returns at once: the thread is free until finish(). Objects may be
  /// added, moved, removed and filtered meanwhile; that belongs to the next update. No-op if one was started
  /// already.
  ///
  /// It does not wait for the device, unless memory must grow for objects that were added during the last
  /// update.
  /// @throws Error as update() does.
  void begin();

  /// Waits for the update that was begun, or does one if none was, and returns what it changed: the state of
  /// the objects is that of the moment of begin().
  /// @throws Error as update() does; the update that was begun is then over, and the next one finds what it
  /// would have.
  Delta finish();

  /// Keeps the Delta that update() or finish() last returned as it is, even if further updates follow or this
  /// object is destroyed, for callers who cannot know when somebody looks at it last. The next updates then
  /// use other memory, which takes longer if there is always another Delta that is kept; what is kept may be
  /// much larger than the lists. Null if nothing had moved, and the lists are empty.
  [[nodiscard]] std::shared_ptr<const void> delta_memory() const;

  /// All pairs as of the last update, in canonical order.
  /// @throws Error while an update that begin() started is not finished, and if the device fails.
  [[nodiscard]] std::vector<Pair> pairs() const;

  /// Number of objects.
  [[nodiscard]] std::size_t size() const noexcept;

  /// The device that does the next update, null if that is the host. Owned by this object.
  [[nodiscard]] const Device* device() const noexcept;

  /// The algorithm in use.
  [[nodiscard]] const AlgorithmInfo& algorithm() const noexcept;

  /// Memory on the device and for it; none if no device was opened. Buffers grow with boxes and pairs,
  /// and never shrink.
  [[nodiscard]] MemoryUse memory() const noexcept;

  /// The stages of the last update, in order; none if nothing had moved. Valid until the next.
  [[nodiscard]] std::span<const Stage> profile() const noexcept;

 private:
  friend class mpi::Region;
  /// As map(), but its boxes are packed: proper, or all NaN if they are empty.
  std::span<Aabb> map_packed(std::size_t n);

  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// All pairs of objects that have a label in common, in canonical order, for BroadPhase::set_exclusions(): if
/// the objects are edges or faces of a mesh, labels are the numbers of their vertices. Any number of threads
/// may call it at once.
/// @param labels `per_object` labels of object 0, then as many of object 1, and so on.
/// @throws Error if there are not as many for each; std::bad_alloc.
[[nodiscard]] BROADCL_API std::vector<Pair> pairs_that_share(std::span<const std::uint32_t> labels,
                                                             std::size_t per_object);

/// All pairs of an object of one set and an object of another that have a label in common, in canonical
/// order, for overlapping_pairs(): if the sets are the faces and the vertices of a mesh, three labels per
/// face, and one per vertex, its number. As with one set.
[[nodiscard]] BROADCL_API std::vector<Pair> pairs_that_share(std::span<const std::uint32_t> first_labels,
                                                             std::size_t per_first,
                                                             std::span<const std::uint32_t> second_labels,
                                                             std::size_t per_second);

/// All overlapping pairs of boxes in the caller's memory, in any layout, by index, in canonical order. The
/// boxes are read once, and not stored. By default the host does it; a device that is named is opened each
/// time, so if you call it often, keep a BroadPhase. Any number of threads may call it at once, also with the
/// same boxes.
/// @param exclusions Pairs of indices that are not reported, in any order: see BroadPhase::set_exclusions().
/// @throws Error for a NaN bound (it names the first such box), for an exclusion of a box with itself or of
/// one that is not there, and as BroadPhase does; std::bad_alloc.
[[nodiscard]] BROADCL_API std::vector<Pair> overlapping_pairs(
    const BoxView& boxes, const BroadPhase::Config& config = BroadPhase::Config(),
    std::span<const Pair> exclusions = {});

/// All overlapping pairs of a box of one set and a box of another: `a` is the index of the former, `b` that
/// of the latter. Nothing is tested inside a set. (For two sets that move, keep a BroadPhase with the filters
/// first_set and second_set.)
/// @param exclusions Pairs that are not reported, in any order: `a` is an index of the first set, `b` of the
/// second.
/// @returns Pairs in canonical order: by b, then by a, which may be greater.
/// @throws Error for a NaN bound (it names the first such box), for an exclusion of a box that is not there,
/// for more than 2^31 boxes together, and as BroadPhase does; std::bad_alloc.
[[nodiscard]] BROADCL_API std::vector<Pair> overlapping_pairs(
    const BoxView& first, const BoxView& second, const BroadPhase::Config& config = BroadPhase::Config(),
    std::span<const Pair> exclusions = {});

/// The same as with one set, for any other range of boxes, temporary ones included. Those that no BoxView
/// could view are copied.
template <AabbRange Range>
[[nodiscard]] std::vector<Pair> overlapping_pairs(Range&& boxes,
                                                  const BroadPhase::Config& config = BroadPhase::Config(),
                                                  std::span<const Pair> exclusions = {}) {
  if constexpr (AabbArray<Range&>) {
    return overlapping_pairs(BoxView(boxes), config, exclusions);
  } else {
    std::vector<Aabb> copy;
    if constexpr (std::ranges::sized_range<Range>) copy.reserve(std::ranges::size(boxes));
    for (auto&& box : boxes) copy.push_back(std::forward<decltype(box)>(box));
    return overlapping_pairs(copy, config, exclusions);
  }
}

}  // namespace broadcl
