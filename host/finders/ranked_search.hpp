#pragma once

#include <cstddef>

#include "engines/ranked_search.hpp"
#include "finders/tile_search.hpp"

namespace broadcl {

/// Passes the boxes that a search wants to it (Roussopoulos, Kelley, Vincent, "Nearest Neighbor Queries",
/// SIGMOD 1995). Allocates nothing.
template <std::size_t axes, class Box>
using RankedTileSearch = void (*)(RankedSearch<Box>& search, const HostTiles<axes>& all);

/// @param plain Whether to return the version for any processor, instead of the one for this processor.
template <std::size_t axes, class Box>
[[nodiscard]] RankedTileSearch<axes, Box> ranked_tile_search(bool plain = false);

}  // namespace broadcl
