#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>
#include <broadcl/algorithms.hpp>
#include <broadcl/config.hpp>
#include <broadcl/device.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/memory.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

#include "base/non_copyable.hpp"
#include "base/packed_box.hpp"
#include "base/threads.hpp"
#include "opencl/process.hpp"

namespace broadcl {

class ArrivingBoxes;
class BoxTree;

/// The slots that changed since the last update.
struct SlotChanges {
  /// Every slot counts as changed, and `slots` is not read.
  bool all = false;
  /// Slots whose box, filter or object changed; each once, and at most a quarter of the slots.
  std::span<const std::uint32_t> slots{};
  /// Slots whose object is not that of the last update, so that all old pairs of the slot end. Ascending.
  std::span<const std::uint32_t> recycled{};
};

/// Which objects may pair, and what of that changed since the last update.
struct PairRules {
  /// One filter per slot; none if all objects have the default one. Read in begin() only.
  std::span<const Filter> filters{};
  /// Pairs of slots that are never reported, in canonical order, each once. Read in begin() only.
  std::span<const Pair> exclusions{};
  /// One per slot: how far its object reaches beyond its box (base/distance.hpp); none if no object ever had
  /// a reach. Two objects are then a pair if their boxes are within the sum of their reaches. Read in begin()
  /// only. A slot whose reach is not that of the last update is among those that changed.
  std::span<const float> reaches{};
  bool all_changed = false;  ///< Every filter, and the exclusions, count as changed.
  /// Slots whose filter is not that of the last update; each once. Those beyond the boxes of the last update
  /// need not be among them if they are recycled. Not read if `all_changed` is set.
  std::span<const std::uint32_t> refiltered{};
  bool filters_changed = false;     ///< Whether the filter of a slot changed that was not recycled.
  bool exclusions_changed = false;  ///< Since the last update.
  bool worlds = false;              ///< Whether some object is in a world other than 0.
  bool sets = false;                ///< Whether the filters part the objects into two sets: TwoSets.
  bool sets_decide = false;         ///< If so, whether every two objects of different sets may pair.

  [[nodiscard]] bool are_exclusions_new() const noexcept { return all_changed || exclusions_changed; }
};

/// The input of an update. What it refers to belongs to the caller and, except for the filters, stays
/// unchanged until the update is finished.
struct Input {
  /// Those of Algorithm::boxes() that are tested, from the first on.
  std::span<const Aabb> boxes{};
  /// If not null, it is still writing the boxes, and begin() must wait for them. Only if uploads_boxes(), and
  /// if all count as changed.
  ArrivingBoxes* arriving = nullptr;
  SlotChanges changed{};
  /// Those slots among them that Algorithm::read() has not read; null: all.
  const SlotChanges* unread = nullptr;
  PairRules rules{};

  /// For a tree, which has read the others.
  [[nodiscard]] Input for_tree() const {
    Input input = *this;
    if (unread != nullptr) input.changed = *unread;
    return input;
  }
};

/// Pairs whose boxes have a bound in common or, with reaches, are near the limit.
struct Touching {
  bool all = false;           ///< Whether they are all such pairs, not only those of slots that changed.
  std::vector<Pair> pairs{};  ///< In any order.
};

/// An algorithm for a BroadPhase: stores the boxes, finds the pairs, and remembers the pairs of the last
/// update.
///
/// Boxes are in slots 0, 1, ...; a slot that is free, or whose box is empty, contains packed_empty().
class Algorithm : NonCopyable {
 public:
  virtual ~Algorithm() = default;

  /// Reserves memory for at least this many slots, and keeps the existing boxes. Must not be called during an
  /// update. May block, so that begin() does not have to.
  /// @param filters Whether updates will have filters.
  /// @throws Error, std::bad_alloc; nothing has changed then, except perhaps where boxes() are.
  virtual void reserve(std::size_t slots, bool filters) = 0;

  /// Reserves memory for this many exclusions of the next update. Otherwise like reserve().
  virtual void reserve_exclusions(std::size_t /*count*/) {}

  /// Gives back memory that is not needed for the boxes of this many slots and for the pairs of the last
  /// update: also that for filters, and the lists that finish() returned. Must not be called during an
  /// update.
  /// @throws Error, std::bad_alloc; boxes and pairs are then as before.
  virtual void shrink(std::size_t slots) = 0;

  /// The boxes, in memory that the caller may write between updates; at least as many as were reserved.
  /// Those that the caller has not written yet are packed_empty(). Valid until the next reserve(), shrink()
  /// or finish(), or until reserve_exclusions(), begin() or flush() throws.
  [[nodiscard]] virtual std::span<Aabb> boxes() noexcept = 0;

  /// Memory for as many other boxes, which are packed_empty() at first, and again if reserve() or shrink()
  /// moved the boxes; after swap_boxes(), it has the boxes from before. Valid as long as boxes().
  /// @throws Error, std::bad_alloc; nothing has changed then, except perhaps where boxes() are.
  [[nodiscard]] virtual std::span<Aabb> spare_boxes() = 0;
  /// Makes them the boxes, and the boxes the spare ones. Not during an update.
  virtual void swap_boxes() noexcept = 0;

  /// An owner of the memory of boxes(), which may outlive this object.
  [[nodiscard]] virtual std::shared_ptr<const void> boxes_owner() const = 0;

  /// Whether begin() copies boxes to a device, which gains time if they are still being written:
  /// Input::arriving.
  [[nodiscard]] virtual bool uploads_boxes() const noexcept { return false; }

  /// Starts an update without waiting for the device; finish() must follow.
  virtual void begin(const Input& input) = 0;
  /// Makes the device start the commands that begin() enqueued.
  virtual void flush() {}
  /// Ends the update. If begin(), flush() or finish() throws, the pairs of the last update are still known,
  /// and the next update must have all slots and rules count as changed. The returned lists stay unchanged
  /// until the next finish(), even if another update begins before that, and as long as the Delta or a copy
  /// of it exists.
  virtual Delta finish() = 0;

  /// The pairs of an algorithm that is used only once, instead of an update. Afterwards boxes() are as
  /// before.
  /// @throws As begin() and finish().
  [[nodiscard]] virtual std::vector<Pair> find_all(const Input& input) {
    begin(input);
    const Delta delta = finish();
    return {delta.added.begin(), delta.added.end()};
  }

  /// The pairs of the last update whose boxes touch: touching.hpp. To be called before anything changes.
  /// @param axes On one of these axes.
  /// @throws Error, std::bad_alloc; nothing has changed then.
  [[nodiscard]] virtual Touching touching(AxisSet axes) = 0;

  /// The tree of its updates, which read() puts boxes into; null if it has none.
  [[nodiscard]] virtual BoxTree* tree() noexcept { return nullptr; }
  /// Puts what changed since the last update or call into tree(). Not during an update.
  /// @throws std::bad_alloc; the tree is then not ready.
  virtual void read(const Input& /*input*/) {}

  /// A rough estimate of the seconds that an update takes, as if few boxes overlapped; 0 if unknown.
  [[nodiscard]] virtual double expected_seconds(std::size_t /*slots*/, std::size_t /*changed*/) const {
    return 0;
  }

  /// All pairs as of the last update.
  [[nodiscard]] virtual std::vector<Pair> pairs() = 0;
  /// The device in use; null on the host.
  [[nodiscard]] virtual const Device* device() const noexcept = 0;
  /// OpenCL memory; none for an algorithm of the host.
  [[nodiscard]] virtual MemoryUse memory() const noexcept { return {}; }
  [[nodiscard]] virtual std::span<const Stage> profile() const noexcept = 0;
};

/// Deletes an algorithm, except one on a device in a process that was forked after OpenCL was used.
struct DeleteAlgorithm {
  DeleteAlgorithm() = default;
  template <class Derived>
  DeleteAlgorithm(std::default_delete<Derived> /*deleter*/) noexcept {}
  void operator()(const Algorithm* algorithm) const noexcept {
    if (algorithm->device() == nullptr || !opencl::is_forked()) delete algorithm;
  }
};
using AlgorithmPointer = std::unique_ptr<Algorithm, DeleteAlgorithm>;

class PairFinder;
namespace opencl {
class Context;
}

/// Makes a PairFinder; the context must outlive it.
/// @throws cl::Error, Error
using MakePairFinder = std::unique_ptr<PairFinder> (*)(const opencl::Context& context);

/// A row of the table of algorithms, with a function that makes either the whole algorithm or its PairFinder.
struct AlgorithmRow {
  AlgorithmInfo info;
  AlgorithmPointer (*make)(const Config& config) = nullptr;
  MakePairFinder make_finder = nullptr;
};

/// @throws Error that lists the algorithms.
[[nodiscard]] const AlgorithmRow& find_algorithm(std::string_view name);

/// Whether Config::device or BROADCL_DEVICE names a device.
[[nodiscard]] bool names_device(const Config& config);

/// @throws Error as find_algorithm() and the algorithm's constructor do.
[[nodiscard]] BROADCL_API AlgorithmPointer make_algorithm(const Config& config);

/// @throws Error as find_algorithm() does, and for an algorithm without a PairFinder.
[[nodiscard]] MakePairFinder find_pair_finder(std::string_view name);

// Each algorithm is defined in the file of its name. Of the two functions for `auto`, one makes the algorithm
// that chooses between host and device, the other the PairFinder that chooses among those of the device.
[[nodiscard]] AlgorithmPointer make_auto(const Config& config);
[[nodiscard]] std::unique_ptr<PairFinder> make_auto(const opencl::Context& context);
[[nodiscard]] std::unique_ptr<PairFinder> make_brute_force(const opencl::Context& context);
[[nodiscard]] std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context);
/// @param sort_work Sort again once searches have exceeded their work in a new order by this much per box. A
/// negative number: in every frame. Infinity: only if the number of slots changed.
/// @param fewest_early The fewest boxes that are searched before they are uploaded: NearPairs.
[[nodiscard]] std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context, double sort_work,
                                                     std::size_t fewest_early);
[[nodiscard]] AlgorithmPointer make_gpu_bf(const Config& config);
[[nodiscard]] AlgorithmPointer make_sweep_and_prune(const Threads& threads);
[[nodiscard]] AlgorithmPointer make_oracle(const Config& config);

}  // namespace broadcl
