#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/broad_phase.hpp>
#include <broadcl/mpi.hpp>

#include "base/threads.hpp"
#include "mpi/bounds.hpp"
#include "mpi/halo_search.hpp"
#include "mpi/halos.hpp"
#include "mpi/objects.hpp"
#include "mpi/ranks.hpp"
#include "mpi/stages.hpp"

namespace broadcl::mpi {

/// Finds the pairs of objects of different ranks. Each rank tells the others bounds of its objects. Of each
/// two ranks, one sends those of its objects that overlap the other's bounds, its halo, and the other one
/// searches them against its own that overlap the bounds of the first. If two boxes overlap, both are among
/// these, so every pair is found, and by one rank only; and so were they in the last update, so a pair that
/// is found or lost has really begun or ended.
///
/// Functions are collective unless they are noexcept. If one throws on one rank, it throws on all.
class CrossPairs {
 public:
  CrossPairs(const Config& config, std::size_t rank, std::size_t ranks);

  /// For each pair of two ranks, of the rank of its first object. Not collective.
  /// @param pairs In canonical order; their first objects are of this rank, their second ones are not.
  void set_exclusions(std::vector<MpiPair> pairs) noexcept;

  /// Restores the halos of the last update if one has failed since. Must precede the others.
  void restore(const Ranks& ranks);
  /// Starts the update of the objects, and meanwhile finds what changed since the last commit().
  void update(const Ranks& ranks, Objects& objects, Stages& stages);
  // What it found, of the pairs whose first object is of this rank; valid until the next update.
  [[nodiscard]] std::span<const MpiPair> added() const noexcept { return added_; }
  [[nodiscard]] std::span<const MpiPair> removed() const noexcept { return removed_; }
  /// Must follow once the update has succeeded on all ranks.
  void commit() noexcept;

  /// All pairs whose first object is of this rank, as of the last commit().
  [[nodiscard]] std::vector<MpiPair> pairs(const Ranks& ranks);

  [[nodiscard]] std::size_t bytes_sent() const noexcept { return bytes_sent_; }
  /// In addition to that of the objects.
  [[nodiscard]] MemoryUse memory(const MemoryUse& of_objects) const noexcept {
    const MemoryUse own = search_.broad_phase().memory();
    return {.device = of_objects.device + own.device,
            .device_peak = of_objects.device_peak + own.device_peak,
            .pinned = of_objects.pinned + own.pinned};
  }

 private:
  void find_halos(const Ranks& ranks, Objects& objects, Stages& stages);
  void exchange_bounds(const Ranks& ranks, Objects& objects, bool is_due);
  void receive_halos();
  void exchange(const Ranks& ranks);
  void write_pairs();
  void collect();
  [[nodiscard]] std::span<const MpiPair> exclusions_with(std::size_t other) const;

  std::size_t rank_;
  Threads threads_;
  OwnBounds own_bounds_;
  Neighbours neighbours_;
  std::vector<HaloHistory> halos_;  // by rank: Neighbours
  HaloSearch search_;
  std::vector<MpiPair> exclusions_;
  bool have_exclusions_changed_ = false;
  bool is_lost_ = false;        // An update began that was not committed.
  bool are_bounds_due_ = true;  // since an update failed

  // Of this update.
  std::vector<Halo> near_;  // by halo
  bool is_any_changed_ = false;
  std::vector<Bytes> out_, in_;  // messages, by rank
  Bytes own_halo_;
  std::vector<MpiPair> added_, removed_;
  std::size_t bytes_sent_ = 0;
};

}  // namespace broadcl::mpi
