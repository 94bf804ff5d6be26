#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/pair.hpp>

namespace broadcl::mpi {

/// The changes of one or more updates in a row.
using Updates = std::span<const Delta>;

/// Lists of pairs in canonical order.
struct PairLists {
  std::vector<Pair> added, removed;
};

/// What several updates changed together.
/// @param recycled Ids that were given to other objects meanwhile, ascending.
[[nodiscard]] PairLists combined(Updates updates, std::span<const std::uint32_t> recycled);

/// All pairs from before some updates.
/// @param pairs Those from after them, in canonical order.
[[nodiscard]] std::vector<Pair> undone(Updates updates, std::span<const Pair> pairs);

}  // namespace broadcl::mpi
