#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/query.hpp>

#include "base/slot_set.hpp"
#include "base/threads.hpp"
#include "core/core.hpp"
#include "engines/box_tree.hpp"

namespace broadcl {

/// What queries search.
template <class Box>
struct Searched {
  const Core<Box>& core;
  std::size_t slots;
  const BoxTree* tree;                    // null if all boxes are tested one by one
  std::span<const std::uint32_t> unread;  // ids of boxes that are not in the tree
  const SlotSet& unread_set;
  const Threads& threads;
};

/// Which objects queries may find.
template <class Box>
class QueryRules {
 public:
  QueryRules(const Core<Box>& core, const QueryOptions& options) : core_(core), options_(options) {}

  /// Whether neither filters nor exceptions matter.
  [[nodiscard]] bool accept_all() const noexcept {
    return options_.filters.empty() && options_.except.empty();
  }
  [[nodiscard]] bool accept(std::uint32_t query, std::uint32_t id) const noexcept {
    if (!options_.except.empty() && options_.except[query] == id) return false;
    if (options_.filters.empty()) return true;
    const std::span<const Filter> filters = core_.filters();
    return may_pair(filters.empty() ? Filter() : filters[id], filter_of(query));
  }
  [[nodiscard]] std::uint32_t world_of(std::uint32_t query) const noexcept {
    return options_.filters.empty() ? Filter::all_worlds : filter_of(query).world;
  }

 private:
  [[nodiscard]] const Filter& filter_of(std::uint32_t query) const noexcept {
    return options_.filters[options_.filters.size() == 1 ? 0 : query];
  }

  const Core<Box>& core_;
  const QueryOptions& options_;
};

/// @throws Error for options that do not suit so many queries.
void refuse_options(const QueryOptions& options, std::size_t queries);
[[noreturn]] void throw_too_many_hits(std::uint64_t most);

/// What a thread finds for its tiles of queries.
struct FoundHits {
  HitList hits;
  std::array<std::uint32_t, BoxTree::most_queries> counts;  ///< For each query of the present tile.
  std::vector<std::uint32_t> slots;                         ///< Of these, one query after the other.
  std::vector<double> keys;                                 ///< Of these, if there are any.
};

/// The hits of queries. If these are many, those near each other are in a tile.
/// @param boxes Where they are, roughly.
/// @param find Called by several threads: appends the hits of a tile, whose queries it gets by index.
/// @returns The keys as squared distances.
[[nodiscard]] Hits collect_hits(
    std::span<const Aabb> boxes, const QueryOptions& options, const Threads& threads,
    const std::function<void(std::span<const std::uint32_t> queries, FoundHits& found)>& find);

}  // namespace broadcl
