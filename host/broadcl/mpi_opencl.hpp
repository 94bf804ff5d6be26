#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

/// For boxes that are distributed over the ranks of an MPI program, and are already on each rank's OpenCL
/// device. Only this header needs both.

#include <broadcl/mpi.hpp>
#include <broadcl/opencl.hpp>

namespace broadcl {

/// A DeviceBroadPhase across all ranks of a communicator: as an MpiBroadPhase, but for boxes that are on each
/// rank's device. Pairs of two objects of a rank stay there; pairs with objects of other ranks, which are
/// few if objects near each other are on the same rank, are found with the help of the host and returned
/// there.
///
/// Object k of a rank is the box at index k, the same object in every update. Its MpiId is
/// mpi_id(rank, k).
///
/// The constructor, update(), pairs() and the destructor are collective. What MpiBroadPhase says about MPI,
/// about failures, and about threads holds here, too; nothing else may use the queue during a call.
class BROADCL_MPI_API MpiDeviceBroadPhase {
 public:
  using Config = DeviceBroadPhase::Config;
  using Boxes = DeviceBroadPhase::Boxes;

  /// What changed since the last update, of the pairs whose first object is on this rank: those of two
  /// objects of this rank, followed by those with objects of other ranks. Both are in canonical order, and so
  /// are they together. Valid until the next update().
  struct Result {
    DeviceBroadPhase::Result own{};      ///< By index, on the device.
    std::span<const MpiPair> added{};    ///< With objects of other ranks, on the host.
    std::span<const MpiPair> removed{};  ///< Likewise.
  };

  /// All pairs whose first object is on this rank, in the same order.
  struct Pairs {
    DeviceBroadPhase::PairBuffer own{};  ///< By index, on the device; valid until the next call.
    std::vector<MpiPair> with_others;    ///< With objects of other ranks.
  };

  /// Collective.
  /// @param comm Duplicated.
  /// @param queue Of this rank's device: see DeviceBroadPhase. mpi_device() names one for each rank.
  /// @param config If Config::threads is 0, the ranks of a node share its processors.
  /// @throws Error as DeviceBroadPhase does, on all ranks.
  explicit MpiDeviceBroadPhase(MPI_Comm comm, cl_command_queue queue, const Config& config = Config());
  /// Collective; before MPI_Finalize(). Wait for the queue before the process ends.
  ~MpiDeviceBroadPhase();
  MpiDeviceBroadPhase(MpiDeviceBroadPhase&&) noexcept;
  MpiDeviceBroadPhase& operator=(MpiDeviceBroadPhase&&) noexcept;

  /// Replaces this rank's list of pairs that are never reported, whatever their boxes and filters. Initially
  /// the list is empty. Waits for the queue.
  /// @param pairs Those whose first object is on this rank, in any order; copied.
  /// @throws Error for another pair, and for a pair of an object with itself; the list is then as before.
  void set_exclusions(std::span<const MpiPair> pairs);

  /// Collective. Finds every pair of overlapping boxes whose filters allow it, and returns the changes since
  /// the last update; objects of this rank beyond its last box no longer exist. Waits for the queue.
  /// @param boxes Of this rank, in a buffer of the queue's context, without Boxes::second and
  /// Boxes::ordered_worlds. Their number may change from update to update.
  /// @throws Error on all ranks.
  Result update(const Boxes& boxes);

  /// Collective. All pairs as of the last update.
  /// @throws Error on all ranks.
  [[nodiscard]] Pairs pairs();

  /// This rank's device. Owned by this object.
  [[nodiscard]] const Device& device() const noexcept;
  /// OpenCL memory in use on this rank, without the caller's buffers.
  [[nodiscard]] MemoryUse memory() const noexcept;
  /// The stages of the last update on this rank: see MpiBroadPhase::profile().
  [[nodiscard]] std::span<const Stage> profile() const noexcept;
  /// As MpiBroadPhase::bytes_sent().
  [[nodiscard]] std::size_t bytes_sent() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace broadcl

#endif
