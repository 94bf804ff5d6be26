#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

/// For boxes that are distributed over the ranks of an MPI program, each of which has a device. Only this
/// header needs MPI.

#include <mpi.h>

#include <compare>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>
#include <broadcl/config.hpp>
#include <broadcl/device.hpp>
#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/memory.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

namespace broadcl {

/// Identifies an object of any rank: the rank in the upper 32 bits, the object's id on that rank in the lower
/// 32 bits. So these ids compare by rank first, then by id.
using MpiId = std::uint64_t;

[[nodiscard]] constexpr MpiId mpi_id(int rank, std::uint32_t id) noexcept {
  return static_cast<MpiId>(rank) << 32U | id;
}
[[nodiscard]] constexpr int rank_of(MpiId id) noexcept {
  return static_cast<int>(id >> 32U);
}
[[nodiscard]] constexpr std::uint32_t local_id(MpiId id) noexcept {
  return static_cast<std::uint32_t>(id);
}

/// Two overlapping boxes, a < b. Pairs compare in canonical order, as Pair does: by b, then by a.
struct MpiPair {
  MpiId a;
  MpiId b;

  friend constexpr bool operator==(const MpiPair&, const MpiPair&) = default;
  friend constexpr std::strong_ordering operator<=>(const MpiPair& s, const MpiPair& t) noexcept {
    if (const auto by_b = s.b <=> t.b; std::is_neq(by_b)) return by_b;
    return s.a <=> t.a;
  }
};

/// What changed between two updates, of the pairs whose first object is on this rank: those of two objects of
/// this rank, followed by those with objects of other ranks. Both are in canonical order, and so are they
/// together, since ids compare by rank first.
struct MpiDelta {
  Delta own{};  ///< By the objects' ids on this rank. Valid as long as this or a copy of it exists.
  // The spans belong to the MpiBroadPhase and are valid until its next update().
  std::span<const MpiPair> added{};    ///< With objects of other ranks.
  std::span<const MpiPair> removed{};  ///< With objects of other ranks.
};

/// A BroadPhase across all ranks of a communicator. Each rank has its own objects, anywhere in space; pairs
/// form among all of them. For any number of ranks and any distribution of the objects, the lists of all
/// ranks together are those of one BroadPhase that has all objects.
///
/// Each rank's device finds the pairs of its own objects. Only objects near those of another rank, its halo,
/// are sent to that rank. So place objects that are near each other on the same rank. If objects lie
/// anywhere, each rank gets the boxes of all others, which is as slow as it sounds.
///
/// The constructor, update(), pairs() and the destructor are collective: all ranks of the communicator call
/// them, in the same order. So is an assignment to an object that is in use, because it destroys that one.
/// All other functions concern only the calling rank. MPI must have been initialised for MPI_THREAD_FUNNELED
/// or more; this class calls MPI in the thread that calls its functions, which has to be the main thread if
/// MPI supports no more than MPI_THREAD_FUNNELED.
///
/// If a collective function fails on one rank, also for lack of memory, it throws the same Error, which names
/// that rank, on all ranks. It has then changed nothing on any rank, and may be repeated. (If MPI itself
/// fails, it ends the program, unless the communicator has another error handler; then the ranks that notice
/// the failure throw Error.)
///
/// Not synchronised: only one thread at a time may use an object. Movable, not copyable; an object that was
/// moved from may only be destroyed or assigned to.
class BROADCL_MPI_API MpiBroadPhase {
 public:
  using Config = broadcl::Config;

  /// Collective. Opens this rank's device: see mpi_device().
  /// @param comm Duplicated.
  /// @param config For this rank; ranks may differ. If Config::threads is 0, the ranks of a node share its
  /// processors.
  /// @throws Error as BroadPhase does.
  explicit MpiBroadPhase(MPI_Comm comm, const Config& config = Config());
  /// Collective; before MPI_Finalize().
  ~MpiBroadPhase();
  MpiBroadPhase(MpiBroadPhase&&) noexcept;
  MpiBroadPhase& operator=(MpiBroadPhase&&) noexcept;

  // The objects of this rank: as in BroadPhase.

  /// Adds an object and returns its id on this rank: the lowest that is free.
  /// @throws Error for a NaN bound.
  std::uint32_t add(const Aabb& box, const Filter& filter = Filter());

  /// Replaces the box of an object.
  /// @throws Error for an unknown id and for a NaN bound.
  void move(std::uint32_t id, const Aabb& box);

  /// Replaces the filter of an object.
  /// @throws Error for an unknown id.
  void set_filter(std::uint32_t id, const Filter& filter);

  /// Replaces this rank's list of pairs that are never reported, whatever their boxes and filters: see
  /// BroadPhase::set_exclusions(). Initially the list is empty.
  /// @param pairs Those whose first object is on this rank, in any order; copied.
  /// @throws Error for another pair, and for a pair of an object with itself.
  void set_exclusions(std::span<const MpiPair> pairs);

  /// Removes an object; its id may be given to the next one added.
  /// @throws Error for an unknown id.
  void remove(std::uint32_t id);

  /// Makes 0 .. n-1 the ids of the objects of this rank, and returns their boxes, for the caller to write.
  /// New objects have empty boxes until then. All objects count as moved.
  /// @returns n boxes, valid until the next call of a function of this object that is not const. If one of
  /// them has a NaN bound, the next update() throws an Error on all ranks.
  std::span<Aabb> map(std::size_t n);

  /// Collective. Finds every pair of overlapping boxes whose filters allow it, and returns the changes since
  /// the last update, of the pairs whose first object is on this rank.
  /// @throws Error on all ranks.
  MpiDelta update();

  /// Collective. All pairs, as of the last update, whose first object is on this rank, in canonical order.
  /// @throws Error on all ranks.
  [[nodiscard]] std::vector<MpiPair> pairs();

  /// Number of objects of this rank.
  [[nodiscard]] std::size_t size() const noexcept;

  /// This rank's device; null for the host. Owned by this object.
  [[nodiscard]] const Device* device() const noexcept;

  /// OpenCL memory in use on this rank.
  [[nodiscard]] MemoryUse memory() const noexcept;

  /// The stages of the last update on this rank: those of the search among its own objects, as
  /// BroadPhase::profile() has them; then, by the host's clock, "begin" (starts that search, and decides
  /// which objects other ranks need), "halo" (makes lists of these), "send", "find" (searches the halos),
  /// "return" (sends the changes to the ranks of the first objects) and "finish" (waits for the first
  /// search). All but "find" include waiting for other ranks. Valid until the next update().
  [[nodiscard]] std::span<const Stage> profile() const noexcept;

  /// Bytes of boxes and pairs that this rank sent to others in the last update, until pairs() is called.
  [[nodiscard]] std::size_t bytes_sent() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// Collective. A selector for Config::device that distributes the GPUs of a node among its ranks in turn.
/// These are the GPUs of one platform, that of select_device("gpu"). Empty if the node has no GPU, or if
/// BROADCL_DEVICE names a device.
/// @throws Error on all ranks if OpenCL fails on one.
[[nodiscard]] BROADCL_MPI_API std::string mpi_device(MPI_Comm comm);

}  // namespace broadcl

#endif
