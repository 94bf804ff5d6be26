#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/query.hpp>

#include "near.hpp"

namespace broadcl::test {

/// By id; no box if there is no such object.
template <class Box>
struct Objects {
  std::vector<std::optional<Box>> boxes;
  std::vector<Filter> filters;
  std::vector<BoundOf<Box>> reaches;

  void resize(std::size_t n) {
    for (std::size_t id = 0; id < n; ++id) {
      if (id < boxes.size() && boxes[id]) continue;
      set(id, {{1, 1, 1}, {0, 0, 0}}, {});
    }
    boxes.resize(n);
    filters.resize(n);
    reaches.resize(n);
  }
  void set(std::size_t id, const Box& box, const Filter& filter, BoundOf<Box> reach = 0) {
    boxes.resize(std::max(boxes.size(), id + 1));
    filters.resize(boxes.size());
    boxes[id] = box;
    filters[id] = filter;
    reaches.resize(boxes.size());
    reaches[id] = reach;
  }
  void replace(std::span<const Box> others) {
    resize(others.size());
    std::ranges::copy(others, boxes.begin());
  }
};

/// What queries must find.
template <class Box>
[[nodiscard]] Hits expected_hits(const Objects<Box>& objects, std::span<const Box> queries,
                                 const QueryOptions& options) {
  Hits hits{.offsets = {0}};
  const auto within = static_cast<BoundOf<Box>>(options.within.value_or(0));
  for (std::size_t k = 0; k < queries.size(); ++k) {
    std::uint32_t count = 0;
    for (std::uint32_t id = 0; id < objects.boxes.size() && count < options.limit; ++id) {
      if (!objects.boxes[id] || !are_near(queries[k], *objects.boxes[id], within, objects.reaches[id]))
        continue;
      if (!options.except.empty() && options.except[k] == id) continue;
      if (!options.filters.empty() &&
          !may_pair(options.filters[options.filters.size() == 1 ? 0 : k], objects.filters[id]))
        continue;
      ++count;
      if (!options.count_only) hits.ids.push_back(id);
    }
    hits.offsets.push_back(hits.offsets.back() + count);
  }
  return hits;
}

}  // namespace broadcl::test
