#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/broad_phase.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/mpi.hpp>

#include "base/threads.hpp"
#include "mpi/halos.hpp"

namespace broadcl::mpi {

/// Pairs with the objects of another rank, in canonical order.
struct PairChanges {
  std::vector<MpiPair> added, removed;
};

/// Finds the pairs of an object of this rank and an object of another one. The objects of both come as halos:
/// this rank's own, and those of the ranks that send to it.
///
/// Each object is in a slot of a BroadPhase, and stays there as long as it is in its halo. So the changes
/// among the slots are the changes of pairs. In the filters of slots, the body says to which of the two sets
/// an object belongs. Bodies and exclusions of the user are compared afterwards; an object for which one of
/// these changes moves to another slot, so that all of its pairs are compared again.
class HaloSearch {
 public:
  HaloSearch(const Config& config, std::size_t rank, std::size_t ranks);

  /// Removes all objects. Exclusions are those of the last commit().
  void clear();
  /// @param from The rank whose halo changed.
  /// @param changes Must stay valid until find().
  void receive(std::size_t from, const HaloChanges& changes);
  /// Replaces the exclusions with objects of another rank, otherwise than by its changes.
  void set_exclusions(std::size_t other, std::span<const MpiPair> exclusions);
  /// Finds what changed since the last commit(). Must be called once for each.
  void find();
  /// What it found, of pairs with objects of another rank.
  [[nodiscard]] const PairChanges& changes_with(std::size_t rank) const noexcept { return changes_[rank]; }
  void commit() noexcept;

  /// All pairs with objects of each rank, as of the last commit(); no objects may have been received since.
  [[nodiscard]] std::vector<std::vector<MpiPair>> pairs() const;
  [[nodiscard]] const BroadPhase& broad_phase() const noexcept { return search_; }

 private:
  struct Slot {
    MpiId object;
    Filter filter;
    // In this update: whether the object entered its halo, and whether it came to this slot.
    bool is_new, is_fresh;
  };
  using Exclusions = std::shared_ptr<const std::vector<MpiPair>>;
  struct Source {
    std::vector<std::uint32_t> ids, slots;
    Exclusions exclusions, last_exclusions;  // null if there are none
    HaloChanges changes;
  };
  struct Found {
    MpiPair pair;
    std::size_t other_rank;
  };

  std::uint32_t allocate(const Slot& slot);
  void write(std::uint32_t slot, const Aabb& box);
  void release(std::uint32_t slot);
  void refilter(std::uint32_t slot, const Filter& filter);
  void relocate(Source& source, std::size_t position, const Filter& filter);
  void leave(Source& source, std::span<const std::uint32_t> positions);
  void enter(Source& source, std::size_t from, const HaloChanges& changes);
  void write_boxes();
  [[nodiscard]] Filter search_filter(const Slot& slot) const noexcept;
  [[nodiscard]] Found found(const Pair& slots) const noexcept;
  [[nodiscard]] bool share_body(const Pair& slots) const noexcept;
  void cancel_relocated();

  std::size_t rank_;
  Threads threads_;
  BroadPhase search_;
  std::vector<Slot> slots_;
  std::vector<Source> sources_;  // by rank
  std::vector<std::uint32_t> free_;
  // Of this update.
  std::vector<std::uint32_t> freed_, fresh_;
  std::vector<std::uint32_t> written_;  // slots whose boxes are in written_boxes_, not in changes
  std::vector<Aabb> written_boxes_;
  bool has_relocated_ = false;
  std::vector<PairChanges> changes_;             // by rank
  std::vector<std::vector<MpiPair>> relocated_;  // by rank: added pairs of objects that were there before
};

}  // namespace broadcl::mpi
