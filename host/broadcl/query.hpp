#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <broadcl/filter.hpp>

namespace broadcl {

/// What queries find, and how much of it is returned.
struct QueryOptions {
  /// Value of `limit`: no limit.
  static constexpr std::uint32_t all = 0xffffffff;

  /// With which filters the queries ask: one for all, or one for each. An object is found if may_pair()
  /// allows it. With none, everything is found, and no filter is tested.
  std::span<const Filter> filters{};

  /// How many objects each query finds at most: those with the lowest ids, or those that come first in
  /// nearest() and along().
  std::uint32_t limit = all;

  /// None, or for each query the id of an object that it does not find, such as its own; an id that no object
  /// has excludes nothing.
  std::span<const std::uint32_t> except{};

  /// The most objects that all queries together may find, each within its limit. If there are more, the call
  /// throws before memory is exhausted, so a limit that cuts results off is never silent.
  std::uint64_t most_hits = std::uint64_t{1} << 31U;

  /// Whether only the offsets are wanted, and no ids.
  bool count_only = false;

  /// How far from the box of a query objects may be: a query finds what would pair with an object that has
  /// its box and this reach. If not given, 0: what overlaps, touches or reaches to it. nearest() finds what
  /// is at most so far away, whatever the reaches of objects; if it is not given, at any distance.
  std::optional<double> within{};
};

/// What a batch of queries found.
struct Hits {
  /// Of the ids of each query, and their number at the end: one more than queries.
  std::vector<std::uint64_t> offsets{};
  /// Of each query in ascending order, one query after the other; of nearest() and along() in their order.
  /// Empty if they were only counted.
  std::vector<std::uint32_t> ids{};
  /// Of nearest(), for each id: the square of the distance.
  std::vector<double> squared_distances{};
  /// Of along(), for each id: when it is met, in multiples of the direction.
  std::vector<double> times{};

  /// Number of queries.
  [[nodiscard]] std::size_t size() const noexcept { return offsets.empty() ? 0 : offsets.size() - 1; }
  /// The ids that a query found, unless they were only counted. Valid as long as this object is unchanged.
  [[nodiscard]] std::span<const std::uint32_t> operator[](std::size_t query) const {
    return std::span(ids).subspan(offsets[query], offsets[query + 1] - offsets[query]);
  }
};

}  // namespace broadcl

#endif
