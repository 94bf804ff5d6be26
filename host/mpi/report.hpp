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

/// Tells which changes in a region are changes of pairs, and this region's to report.
///
/// A broad phase of a region reports, besides changes of pairs, those of what it knows: objects came and left
/// that overlap now as they did before. A change is real if the pair, tested again, was one in the last
/// update and is none now, or the other way round. It is reported by the region that holds the componentwise
/// maximum of the lower corners of the two boxes, now for a new pair, and at the last update for one that
/// ends: a point of both boxes, so that this region has both.
class Report {
 public:
  Report(std::size_t rank, std::size_t ranks, Workers& workers)
      : rank_(rank), ranks_(ranks), workers_(workers) {}

  enum class Of {
    added,
    removed,
    all,  ///< Not changes but all pairs, as of the last update.
  };

  /// Sorts out which of the pairs of a region's broad phase are reported, and to whom.
  /// @param cuts At the last update, but for pairs that were added.
  void sift(std::span<const Pair> pairs, Of of, const Cuts& cuts, const Objects& objects,
            const Region& region, const Routes& routes);

  /// Writes what other ranks must know.
  /// @param out By rank.
  void write(std::vector<Bytes>& out) const;

  /// What concerns this rank, in canonical order; all pairs are in `added`.
  /// @param in By rank.
  /// @param added, removed Memory for the lists, which grows and may be longer than they are.
  MpiDelta collect(const std::vector<Bytes>& in, std::vector<MpiPair>& added, std::vector<MpiPair>& removed);

 private:
  /// What one thread finds at a time.
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
