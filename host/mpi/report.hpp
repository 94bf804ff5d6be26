#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/mpi.hpp>
#include <broadcl/pair.hpp>

#include "mpi/cuts.hpp"
#include "mpi/merge.hpp"
#include "mpi/messages.hpp"
#include "mpi/objects.hpp"
#include "mpi/region.hpp"
#include "mpi/routes.hpp"
#include "mpi/workers.hpp"

namespace broadcl::mpi {

/// Decides which changes in a region are real changes of pairs, and whether this region has to report them.
///
/// The broad phase of a region also reports pairs that did not change, because their objects entered or left
/// the region. A change is real if, tested again, the pair overlapped in the last update and does not overlap
/// now, or the other way round. It is reported by the region that contains the componentwise maximum of the
/// lower corners of the two boxes; for a new pair, the current boxes count, for one that ended, those of the
/// last update. This point is in both boxes, so that region has both.
class Report {
 public:
  Report(std::size_t rank, std::size_t ranks, Workers& workers)
      : rank_(rank), ranks_(ranks), workers_(workers) {}

  enum class Of {
    added,
    removed,
    all,  ///< Not changes but all pairs, as of the last update.
  };

  /// Selects the pairs of a region's broad phase that are reported, by rank.
  /// @param cuts The current ones for added pairs, otherwise those of the last update.
  void sift(std::span<const Pair> pairs, Of of, const Cuts& cuts, const Objects& objects,
            const Region& region, const Routes& routes);

  /// Writes the messages for other ranks.
  /// @param out By rank.
  void write(std::vector<Bytes>& out) const;

  /// The changes for this rank, in canonical order; all pairs, if they were selected, are in `added`.
  /// @param in By rank.
  /// @param added, removed Memory for the lists, which grows and may be longer than the lists.
  MpiDelta collect(const std::vector<Bytes>& in, std::vector<MpiPair>& added, std::vector<MpiPair>& removed);

 private:
  /// The results of one task.
  struct Part {
    std::vector<MpiPair> own;                  // of two objects of this rank, in canonical order
    std::vector<std::vector<MpiPair>> others;  // by rank of the first object, in any order
  };

  std::size_t rank_;
  std::size_t ranks_;
  Workers& workers_;
  std::vector<Part> added_, removed_;
  std::array<Merge, 2> merges_;
};

}  // namespace broadcl::mpi
