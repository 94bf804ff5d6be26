#pragma once

#include <cstdint>
#include <limits>

#include <broadcl/filter.hpp>

#include "base/moving_box.hpp"
#include "base/non_copyable.hpp"
#include "base/packed_box.hpp"

namespace broadcl {

class CoordinateMap;

/// A search for the boxes with the least keys. A key is the squared distance from a box, or when a moving box
/// meets the other one.
template <class Box>
class RankedSearch : NonCopyable {
 public:
  using Bound = BoundType<Box>;

  static constexpr std::int32_t any_slot = std::numeric_limits<std::int32_t>::max();

  Box box{};                               // packed, not empty
  const MovingBox<Box>* moving = nullptr;  // in place of it
  /// Only objects that may be in the same world have to be found.
  std::uint32_t world = Filter::all_worlds;
  /// Boxes of lower keys are wanted, and those of this one, up to this slot. take() may lower them.
  Bound most{};
  std::int32_t last = any_slot;
  /// Whether to begin with the least keys, so that take() can.
  bool is_limited = false;
  /// How the boxes of the tree were converted, if they were.
  const CoordinateMap* map = nullptr;

  [[nodiscard]] bool wants(Bound key, std::uint32_t slot) const noexcept {
    return key < most || (key == most && static_cast<std::int32_t>(slot) <= last);
  }

  /// Called once for each box of the tree that is wanted then.
  /// @param key If boxes were converted, at most the key of the box.
  virtual void take(std::uint32_t slot, Bound key) = 0;

 protected:
  RankedSearch() = default;
  ~RankedSearch() = default;
};

}  // namespace broadcl
