#pragma once

#include <algorithm>
#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

namespace broadcl::scenes {

/// The objects that a broad phase searches, and what has changed since the last frame. Ids ascend everywhere.
struct RecordedFrame {
  template <class Value>
  struct Of {
    std::uint32_t id;
    Value value;
  };

  std::vector<std::uint32_t> ids;
  std::vector<Aabb> boxes;      ///< One per id, if bounds are float32; otherwise none.
  std::vector<Aabb64> boxes64;  ///< The other way round.

  std::vector<std::uint32_t> gone;   ///< Of objects that were removed; some may be in `added`, too.
  std::vector<std::uint32_t> added;  ///< Of new objects, whose filter is the default and whose reach is 0,
  std::vector<Of<Filter>> filters;   ///< except for these, and
  std::vector<Of<double>> reaches;   ///< these. Those of other objects are new ones.
  std::optional<std::vector<Pair>> exclusions;  ///< The whole list, if it has changed.

  template <class Box>
  [[nodiscard]] const std::vector<Box>& boxes_of() const noexcept {
    if constexpr (std::is_same_v<Box, Aabb64>) {
      return boxes64;
    } else {
      return boxes;
    }
  }
  [[nodiscard]] std::size_t row_of(std::uint32_t id) const noexcept {
    return static_cast<std::size_t>(std::ranges::lower_bound(ids, id) - ids.begin());
  }
};

}  // namespace broadcl::scenes
