#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <broadcl/filter.hpp>
#include <broadcl/query.hpp>

#include "arrays.hpp"
#include "box_array.hpp"

namespace broadcl::python {

/// One value or array per field of a Filter.
class Filters {
 public:
  Filters(nanobind::handle group, nanobind::handle mask, nanobind::handle body, nanobind::handle world,
          std::size_t n)
      : words_{Words(group, "group", {.is_bits = true}), Words(mask, "mask", {.is_bits = true}),
               Words(body, "body", {.remedy = "; broadcl.NO_BODY belongs to none"}),
               Words(world, "world", {.remedy = "; broadcl.ALL_WORLDS is all of them"})} {
    for (const Words& words : words_) {
      if (words.is_single() || words.size() == n) continue;
      throw nanobind::value_error(("filters must be integers, or arrays of length " + std::to_string(n) +
                                   ", not " + std::to_string(words.size()))
                                      .c_str());
    }
  }

  /// As many as there are objects; or one, if it is the same for all.
  [[nodiscard]] std::vector<Filter> list() const {
    std::size_t count = 1;
    for (const Words& words : words_) count = words.is_single() ? count : words.size();
    std::vector<Filter> filters;
    for (std::size_t k = 0; k < count; ++k) filters.push_back((*this)[k]);
    return filters;
  }

  Filter operator[](std::size_t k) const {
    return {.group = words_[0][k], .mask = words_[1][k], .body = words_[2][k], .world = words_[3][k]};
  }

 private:
  std::array<Words, 4> words_;
};

/// What queries find, as callers give it.
class Query {
 public:
  /// @param group As for Filters, except that None is the default; if all four are None, no filter is tested.
  /// @param except None, or an id per query.
  /// @param n The number of queries.
  Query(nanobind::handle group, nanobind::handle mask, nanobind::handle body, nanobind::handle world,
        std::optional<std::uint32_t> limit, nanobind::handle except, std::uint64_t most_hits, bool count_only,
        std::optional<double> within, std::size_t n)
      : options_{.limit = limit.value_or(QueryOptions::all),
                 .most_hits = most_hits,
                 .count_only = count_only,
                 .within = within} {
    if (!group.is_none() || !mask.is_none() || !body.is_none() || !world.is_none()) {
      const Filter none;
      const auto or_default = [](nanobind::handle words, std::uint32_t word) {
        return words.is_none() ? nanobind::object(nanobind::int_(word)) : nanobind::borrow(words);
      };
      filters_ = Filters(or_default(group, none.group), or_default(mask, none.mask),
                         or_default(body, none.body), or_default(world, none.world), n)
                     .list();
    }
    if (!except.is_none()) except_.emplace(except, "except_");
  }

  [[nodiscard]] QueryOptions options() const {
    QueryOptions options = options_;
    options.filters = filters_;
    if (except_) options.except = except_->all();
    return options;
  }

 private:
  QueryOptions options_;
  std::vector<Filter> filters_;
  std::optional<Words> except_;
};

/// How queries move.
struct Ways {
  std::vector<std::array<double, 3>> directions;
  std::vector<double> lengths{};  ///< None if they are infinite.
};

[[nodiscard]] inline Ways to_ways(nanobind::handle directions, nanobind::handle lengths,
                                  const BoxArray& starts) {
  Ways ways{to_vectors(directions, "directions", starts.dimensions() == 2 ? 2 : 3)};
  if (lengths.is_none()) return ways;
  ways.lengths = to_numbers(lengths, "lengths");
  if (!ways.lengths.empty() || starts.view().size() == 0) return ways;
  throw nanobind::value_error("lengths is empty; give None if they are infinite");
}

/// What queries look for.
enum class Verb { overlapping, nearest, along };

/// Offsets and ids as a tuple of two arrays, or of three with squared distances or times.
[[nodiscard]] inline nanobind::tuple to_arrays(Hits&& hits, Verb verb) {
  const nanobind::object offsets = to_array(std::move(hits.offsets));
  const nanobind::object ids = to_array(std::move(hits.ids));
  if (verb == Verb::overlapping) return nanobind::make_tuple(offsets, ids);
  return nanobind::make_tuple(
      offsets, ids, to_array(std::move(verb == Verb::nearest ? hits.squared_distances : hits.times)));
}

}  // namespace broadcl::python
