#pragma once

/// For boxes on the ranks of an MPI program, with a device each. Only this header needs MPI.

#include <mpi.h>

#include <array>
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
#include <broadcl/profile.hpp>

namespace broadcl {

/// An object of any rank: the rank above 32 bits of the id that it has there. So ids compare by rank first,
/// and those of a rank as its own ids do.
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

/// What changed between two updates among the pairs whose first object is of this rank; otherwise as Delta.
/// The spans belong to the MpiBroadPhase and are valid until its next update().
struct MpiDelta {
  std::span<const MpiPair> added;
  std::span<const MpiPair> removed;
};

/// A BroadPhase of all ranks of a communicator together. Each rank has its own objects, anywhere in space;
/// pairs form among all of them. Whatever the number of ranks, and whichever objects each has, the lists of
/// all ranks together are those of one BroadPhase that has all objects.
///
/// Space is divided into regions, one for each rank, which its device searches. Who keeps objects on the rank
/// of their region (region_of()) has little to send.
///
/// The constructor, update(), pairs() and the destructor are collective: all ranks of the communicator call
/// them, in the same order. All other functions concern this rank alone. MPI must have been initialised for
/// MPI_THREAD_FUNNELED or more, and its functions are called by the thread that calls these.
///
/// If a collective function fails on one rank, for lack of memory too, it throws the same Error on all, which
/// names the rank. It has changed nothing then, on any rank, and may be repeated. (If MPI itself fails, it
/// ends the program, unless the communicator has another error handler; then Error says so, on the ranks that
/// notice.)
///
/// Not synchronised: one thread at a time may use an object. Can be moved, not copied; an object that was
/// moved from may only be destroyed or assigned to.
class BROADCL_MPI_API MpiBroadPhase {
 public:
  using Config = broadcl::Config;

  /// Collective. Opens this rank's device: see mpi_device().
  /// @param comm Duplicated.
  /// @param config Of this rank: ranks may differ. If Config::threads is 0, the ranks of a host share its
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

  /// Removes an object; its id may be given to the next one added.
  /// @throws Error for an unknown id.
  void remove(std::uint32_t id);

  /// Makes 0 .. n-1 the ids of the objects of this rank, and returns their boxes, to be written in place. New
  /// objects have empty boxes until then. All of them count as moved.
  /// @returns n boxes, valid until the next call of any other function of this object. A NaN bound among them
  /// is an error of the next update(), on all ranks.
  std::span<Aabb> map(std::size_t n);

  /// Collective. Finds every pair of overlapping boxes that their filters let pair, and returns what changed
  /// since the last update of those whose first object is of this rank.
  /// @throws Error on all ranks.
  MpiDelta update();

  /// Collective. All pairs as of the last update whose first object is of this rank, in canonical order.
  /// @throws Error on all ranks.
  [[nodiscard]] std::vector<MpiPair> pairs();

  /// Number of objects of this rank.
  [[nodiscard]] std::size_t size() const noexcept;

  /// The rank in whose region a point lies, as of the last update.
  [[nodiscard]] int region_of(const std::array<float, 3>& point) const noexcept;

  /// This rank's device, null if that is the host. Owned by this object.
  [[nodiscard]] const Device* device() const noexcept;

  /// Memory on the device and for it.
  [[nodiscard]] MemoryUse memory() const noexcept;

  /// The stages of the last update on this rank, in order, by the host's clock: "agree", what the ranks tell
  /// each other before; "divide" if regions were cut anew; "route", who gets which boxes; "send"; "search";
  /// "report", which changes are this region's; "return", to the ranks of the objects; "collect". Waiting for
  /// other ranks is part of "agree", "send" and "return". If the search had to be set up anew, the first ones
  /// occur twice. Before "search" come its parts, as BroadPhase::profile() of this rank has them, with device
  /// times if Config::profile is set. Valid until the next update.
  [[nodiscard]] std::span<const Stage> profile() const noexcept;

  /// Bytes of boxes and pairs that this rank sent to others in the last update.
  [[nodiscard]] std::size_t bytes_sent() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// Collective. A selector for Config::device, with which the ranks of a host share its GPUs in turn: the GPUs
/// of the platform of the one that select_device("gpu") would take. Empty if the host has none, or if
/// BROADCL_DEVICE names a device.
/// @throws Error on all ranks if OpenCL fails on one.
[[nodiscard]] BROADCL_MPI_API std::string mpi_device(MPI_Comm comm);

}  // namespace broadcl
