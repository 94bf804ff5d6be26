#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/query.hpp>

#include "expected_hits.hpp"
#include "near.hpp"

namespace broadcl::test {

/// By the definition of BasicBroadPhase::along().
template <class Box>
[[nodiscard]] std::optional<BoundOf<Box>> meeting_of(const Box& start,
                                                     const std::array<BoundOf<Box>, 3>& direction,
                                                     BoundOf<Box> length, const Box& object) {
  using Bound = BoundOf<Box>;
  const ScopedRounding rounding(FE_TONEAREST);
  if (is_empty(start) || is_empty(object)) return std::nullopt;
  Bound begin = 0;
  Bound end = length;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const Bound reciprocal = rounded(Bound{1}, direction.at(axis), std::divides());
    if (std::isinf(reciprocal)) {
      if (start.lower[axis] > object.upper[axis] || object.lower[axis] > start.upper[axis])
        return std::nullopt;
      continue;
    }
    std::array times{
        rounded(rounded(object.lower[axis], start.upper[axis], std::minus()), reciprocal, std::multiplies()),
        rounded(rounded(object.upper[axis], start.lower[axis], std::minus()), reciprocal, std::multiplies())};
    if (reciprocal < 0) std::swap(times[0], times[1]);
    begin = std::max(begin, times[0]);
    end = std::min(end, times[1]);
  }
  return begin <= end ? std::optional(begin) : std::nullopt;
}

/// How queries move: one of each for each query.
template <class Box>
struct Ways {
  std::vector<std::array<BoundOf<Box>, 3>> directions;
  std::vector<BoundOf<Box>> lengths;
};

/// What nearest() must find, or, with ways, along().
template <class Box>
[[nodiscard]] Hits expected_ranked_hits(const Objects<Box>& objects, std::span<const Box> queries,
                                        const Ways<Box>* ways, const QueryOptions& options) {
  using Bound = BoundOf<Box>;
  QueryOptions of_one = options;
  of_one.limit = QueryOptions::all;
  of_one.count_only = false;
  of_one.within = {};
  Objects<Box> accepted;  // those that the rules allow, whatever their places
  accepted.filters = objects.filters;
  accepted.reaches.resize(objects.reaches.size());
  accepted.boxes.assign(objects.boxes.size(), Box{{0, 0, 0}, {0, 0, 0}});
  const std::vector<Box> points(queries.size(), Box{{0, 0, 0}, {0, 0, 0}});
  const Hits all = expected_hits<Box>(accepted, points, of_one);
  Hits hits{.offsets = {0}};
  std::vector<double>& keys = ways == nullptr ? hits.squared_distances : hits.times;
  for (std::size_t k = 0; k < queries.size(); ++k) {
    std::vector<std::pair<Bound, std::uint32_t>> found;
    for (const std::uint32_t id : all[k]) {
      const std::optional<Box>& box = objects.boxes[id];
      if (!box || is_empty(*box) || is_empty(queries[k])) continue;
      if (ways != nullptr) {
        const auto time = meeting_of(queries[k], ways->directions[k], ways->lengths[k], *box);
        if (time) found.emplace_back(*time, id);
      } else if (!options.within ||
                 are_near<Box>(queries[k], *box, static_cast<Bound>(*options.within), Bound{0})) {
        found.emplace_back(squared_distance_of(queries[k], *box), id);
      }
    }
    std::ranges::sort(found);
    if (found.size() > options.limit) found.resize(options.limit);
    hits.offsets.push_back(hits.offsets.back() + found.size());
    if (options.count_only) continue;
    for (const auto& [key, id] : found) {
      hits.ids.push_back(id);
      keys.push_back(static_cast<double>(key));
    }
  }
  return hits;
}

inline void expect_same_hits(const Hits& hits, const Hits& expected) {
  EXPECT_EQ(hits.offsets, expected.offsets);
  EXPECT_EQ(hits.ids, expected.ids);
  EXPECT_EQ(hits.squared_distances, expected.squared_distances);
  EXPECT_EQ(hits.times, expected.times);
}

}  // namespace broadcl::test
