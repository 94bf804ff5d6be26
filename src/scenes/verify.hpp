#pragma once

#include <cstddef>

class btCollisionWorld;

namespace broadcl::scenes {

/// How a world's pair cache differs from the oracle.
struct Difference {
  std::size_t missing = 0;  ///< Pairs that overlap and pass the filters, but are not in the cache.
  std::size_t extra = 0;    ///< Pairs in the cache that do not overlap or do not pass the filters.
};

/// Compares a world's pair cache with the `oracle` algorithm over the boxes that its proxies have now,
/// filtered by group and mask both ways. Call it after a step: the boxes are those that the step's broad
/// phase saw.
[[nodiscard]] Difference verify(btCollisionWorld& world);

}  // namespace broadcl::scenes
