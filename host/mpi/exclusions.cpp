#include "mpi/exclusions.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include <broadcl/error.hpp>

namespace broadcl::mpi {

Exclusions::Exclusions(std::span<const MpiPair> pairs, int rank, int ranks) {
  for (auto [a, b] : pairs) {
    if (b < a) std::swap(a, b);
    if (rank_of(a) != rank || rank_of(b) >= ranks) {
      throw Error::invalid_argument("the first object of an excluded pair is of rank " +
                                    std::to_string(rank_of(a)) + ", the second of rank " +
                                    std::to_string(rank_of(b)) + "; give the pair on rank " +
                                    std::to_string(rank_of(a)) + ", of ranks of the communicator");
    }
    if (rank_of(b) == rank) {
      own.push_back({local_id(a), local_id(b)});
    } else {
      of_others.push_back({a, b});
    }
  }
  std::ranges::sort(of_others);
  of_others.erase(std::unique(of_others.begin(), of_others.end()), of_others.end());
}

}  // namespace broadcl::mpi
