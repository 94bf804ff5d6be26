#pragma once

#include <broadcl/export.h>
#include <broadcl/broad_phase.hpp>

#include "engines/ranked_search.hpp"

namespace broadcl::detail {

/// The tree of a broad phase, for searches that answer while they run. Several threads may search, and
/// searches may begin others, as long as no object changes.
template <class Box>
struct BROADCL_API TreeAccess {
  /// Whether all boxes are in the tree as they are now. If not, counts that they are all tested in place of a
  /// search, and reads them if that has taken as long.
  /// @throws Error, std::bad_alloc
  [[nodiscard]] static bool has_all(const BasicBroadPhase<Box>& broad_phase);
  /// Only then. Takes no lock, allocates nothing, and leaves the floating-point environment to the caller.
  static void find(const BasicBroadPhase<Box>& broad_phase, RankedSearch<Box>& search);
};

}  // namespace broadcl::detail
