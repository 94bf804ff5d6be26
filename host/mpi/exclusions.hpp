#pragma once

#include <span>
#include <vector>

#include <broadcl/mpi.hpp>
#include <broadcl/pair.hpp>

namespace broadcl::mpi {

/// The exclusions that a rank was given.
struct Exclusions {
  /// @param rank, ranks This rank, and how many there are.
  /// @throws Error for a pair whose first object is not on this rank.
  Exclusions(std::span<const MpiPair> pairs, int rank, int ranks);

  std::vector<Pair> own;           ///< Of two objects of this rank; in any order.
  std::vector<MpiPair> of_others;  ///< With objects of other ranks; in canonical order, each once.
};

}  // namespace broadcl::mpi
