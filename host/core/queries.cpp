#include "core/queries.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <memory>
#include <mutex>
#include <numeric>
#include <string>
#include <type_traits>
#include <utility>

#include <broadcl/error.hpp>

#include "base/distance.hpp"
#include "base/floating_point.hpp"
#include "base/free_lists.hpp"
#include "base/lanes.hpp"
#include "base/packed_boxes.hpp"
#include "base/parallel.hpp"
#include "base/system.hpp"
#include "core/exact_reaches.hpp"
#include "core/reach.hpp"
#include "engines/box_tree.hpp"

namespace broadcl {
namespace {

/// The tree reads a box in the time in which so many are tested one by one.
constexpr std::size_t tests_per_read = 4;

/// Fewer queries are not sorted.
constexpr std::size_t fewest_sorted = 2 * BoxTree::most_queries;
constexpr std::size_t queries_per_thread = 512;

/// @throws Error
void refuse_options(const QueryOptions& options, std::size_t queries) {
  const auto refuse_count = [&](std::size_t count, const char* of) {
    throw Error::invalid_argument(std::to_string(count) + " " + of + " for " + std::to_string(queries) +
                                  " queries; give none, or one for each");
  };
  if (options.filters.size() > 1 && options.filters.size() != queries)
    refuse_count(options.filters.size(), "filters");
  if (!options.except.empty() && options.except.size() != queries)
    refuse_count(options.except.size(), "exceptions");
  if (options.within) refuse_invalid_reach(*options.within, "within is ");
}

[[noreturn]] void throw_too_many_hits(std::uint64_t most) {
  throw Error("queries find more than " + std::to_string(most) +
              " objects; give fewer queries, a limit, or a larger most_hits");
}

/// What queries search.
template <class Box>
struct Searched {
  const Core<Box>& core;
  const BoxTree* tree;                    // null if all boxes are tested one by one
  std::span<const std::uint32_t> unread;  // ids of boxes that are not in the tree
  const SlotSet& unread_set;
  std::size_t threads;
};

/// Some queries, which are searched for in tiles.
template <class Box>
class TiledQueries {
 public:
  TiledQueries(const Searched<Box>& in, std::span<const Box> queries, const QueryOptions& options)
      : in_(in), queries_(queries), options_(options) {
    refuse_options(options, queries.size());
    const DefaultFloatingPoint as_everywhere;
    within_ = rounded_to<Bound>(options.within.value_or(0));
    convert();
  }

  [[nodiscard]] std::span<const Aabb> images() const noexcept { return images_; }

  /// Finds the hits of a tile of queries, in any order.
  /// @param indices Of the queries.
  [[gnu::noinline]] void find(std::span<const std::uint32_t> indices, HitList& hits) const {
    const DefaultFloatingPoint as_everywhere;
    hits.clear();
    if (in_.tree != nullptr) {
      std::array<QueryBox, BoxTree::most_queries> tile;
      for (std::size_t k = 0; k < indices.size(); ++k) {
        tile[k] = {.box = images_[indices[k]],
                   .reach = reach_of(indices[k]),
                   .world = options_.filters.empty() ? Filter::all_worlds : filter_of(indices[k]).world};
      }
      in_.tree->find(std::span(tile).first(indices.size()), hits);
      keep(indices, hits);
    }
    for (std::uint32_t k = 0; k < indices.size(); ++k) {
      const std::uint32_t end = in_.tree == nullptr ? static_cast<std::uint32_t>(in_.core.ids()) : 0;
      for (std::uint32_t id = 0; id < end; ++id) test(indices, k, id, hits);
      for (const std::uint32_t id : in_.unread) test(indices, k, id, hits);
    }
  }

 private:
  using Bound = BoundType<Box>;

  /// That of the image of a query. (Its box was grown in double precision.)
  [[nodiscard]] float reach_of(std::uint32_t query) const noexcept {
    if constexpr (is_exact) {
      return in_.core.reaches().empty() ? 0 : reach_of_image(images_[query], 0);
    } else {
      return within_;
    }
  }

  [[nodiscard]] const Filter& filter_of(std::uint32_t query) const noexcept {
    return options_.filters[options_.filters.size() == 1 ? 0 : query];
  }

  [[nodiscard]] bool is_near(std::uint32_t query, std::uint32_t id) const noexcept {
    const std::span<const Bound> reaches = in_.core.reaches();
    return is_within(queries_[query], in_.core.packed_box(id), within_ + (reaches.empty() ? 0 : reaches[id]));
  }

  [[nodiscard]] bool accepts(std::uint32_t query, std::uint32_t id) const noexcept {
    if (!options_.except.empty() && options_.except[query] == id) return false;
    if (options_.filters.empty()) return true;
    const std::span<const Filter> filters = in_.core.filters();
    return may_pair(filters.empty() ? Filter() : filters[id], filter_of(query));
  }

  /// Removes the hits of unread boxes, and those that float32 or the options make wrong.
  void keep(std::span<const std::uint32_t> indices, HitList& hits) const {
    if (!is_exact && in_.unread.empty() && options_.filters.empty() && options_.except.empty()) return;
    const auto is_wrong = [&](const Hit& hit) {
      return in_.unread_set.contains(hit.slot) || !accepts(indices[hit.query], hit.slot) ||
             (is_exact && !is_near(indices[hit.query], hit.slot));
    };
    const std::span<Hit> found = hits.get();
    hits.set_end(std::to_address(std::remove_if(found.begin(), found.end(), is_wrong)));
  }

  void test(std::span<const std::uint32_t> indices, std::uint32_t k, std::uint32_t id, HitList& hits) const {
    if (!is_near(indices[k], id) || !accepts(indices[k], id)) return;
    Hit* const next = hits.reserve(1);
    *next = {k, id};
    hits.set_end(next + 1);
  }

  /// Finds the images of the queries in the tree.
  void convert() {
    if constexpr (is_exact) {
      if (in_.tree == nullptr) return;
      converted_.resize(queries_.size());
      for_each_part(queries_.size(), in_.threads,
                    [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
                      const DefaultFloatingPoint as_everywhere;
                      for (std::size_t k = begin; k < end; ++k)
                        converted_[k] = in_.core.image_of(grown(queries_[k], within_));
                    });
      images_ = converted_;
    } else {
      images_ = queries_;
    }
  }

  static constexpr bool is_exact = std::is_same_v<Box, Aabb64>;

  const Searched<Box>& in_;
  std::span<const Box> queries_;
  const QueryOptions& options_;
  Bound within_ = 0;
  std::vector<Aabb> converted_;
  std::span<const Aabb> images_;
};

/// Sorts slots: a few by counting for each how many are less.
void sort_slots(std::span<std::uint32_t> slots) {
  using Lanes = decltype(FourLanes{} <= FourLanes{});
  constexpr std::size_t lanes = sizeof(Lanes) / sizeof(std::int32_t);
  constexpr std::size_t most_counted = 128;
  if (slots.size() > most_counted) {
    std::ranges::sort(slots);
    return;
  }
  std::array<std::int32_t, most_counted> all;
  const std::size_t n = slots.size();
  std::ranges::copy(slots, all.begin());
  std::fill(all.begin() + static_cast<std::ptrdiff_t>(n),
            all.begin() + static_cast<std::ptrdiff_t>((n + lanes - 1) / lanes * lanes),
            std::numeric_limits<std::int32_t>::max());
  for (std::size_t k = 0; k < n; ++k) {
    Lanes before{};
    for (std::size_t first = 0; first < n; first += lanes) {
      Lanes others;
      std::memcpy(&others, &all[first], sizeof others);
      before -= others < all[k];
    }
    const std::int32_t rank = before[0] + before[1] + before[2] + before[3];
    slots[static_cast<std::size_t>(rank)] = static_cast<std::uint32_t>(all[k]);
  }
}

/// Appends the slots that each query of a tile found, in ascending order, but not more than its limit.
/// @param counts Receives how many these are.
void append_slots(std::span<const Hit> hits, std::uint32_t limit,
                  std::span<std::uint32_t, BoxTree::most_queries> counts, std::vector<std::uint32_t>& slots) {
  std::array<std::size_t, BoxTree::most_queries + 1> ends{};
  for (const Hit& hit : hits) ++ends.at(hit.query + 1);
  const std::size_t first = slots.size();
  ends[0] = first;
  for (std::size_t k = 0; k < counts.size(); ++k) ends.at(k + 1) += ends.at(k);
  slots.resize(first + hits.size());
  const auto starts = ends;
  for (const Hit& hit : hits) slots[ends.at(hit.query)++] = hit.slot;
  std::uint32_t* next = slots.data() + first;
  for (std::size_t k = 0; k < counts.size(); ++k) {
    const std::span<std::uint32_t> own = std::span(slots).subspan(starts.at(k), ends.at(k) - starts.at(k));
    sort_slots(own);
    counts[k] = static_cast<std::uint32_t>(std::min<std::size_t>(own.size(), limit));
    next = std::ranges::copy(own.first(counts[k]), next).out;
  }
  slots.resize(static_cast<std::size_t>(next - slots.data()));
}

/// The hits of queries, which are packed.
template <class Box>
Hits search(const Searched<Box>& in, std::span<const Box> queries, const QueryOptions& options) {
  const TiledQueries<Box> search(in, queries, options);
  const std::size_t n = queries.size();
  const bool sorts = n >= fewest_sorted;
  std::vector<std::uint32_t> order;
  if (sorts) {
    const bool is_by_filter = options.filters.size() > 1;
    order = order_in_space(search.images(), is_by_filter ? options.filters : std::span<const Filter>(),
                           in.threads);
  } else {
    for (std::uint32_t k = 0; k < n; ++k) order.push_back(k);
  }
  const std::size_t per_tile = sorts ? BoxTree::most_queries : 1;
  const std::size_t tiles = (order.size() + per_tile - 1) / per_tile;
  const auto tile_of = [&](std::size_t tile) {
    const std::span<const std::uint32_t> all =
        std::span(order).subspan(tile * per_tile, std::min(per_tile, order.size() - tile * per_tile));
    return all.first(static_cast<std::size_t>(std::ranges::find(all, no_query) - all.begin()));
  };
  struct alignas(cache_line) OfThread {
    HitList hits;
    std::vector<std::uint32_t> slots;
  };
  struct OfTile {
    std::size_t thread;
    std::size_t first;
  };
  const std::size_t threads = useful_threads(n, queries_per_thread, in.threads);
  std::vector<OfThread> found(threads);
  std::vector<OfTile> places(tiles);
  std::atomic<std::uint64_t> total = 0;
  Hits result;
  result.offsets.resize(n + 1);
  parallel_for(tiles, threads, [&](std::size_t t, std::size_t thread) {
    OfThread& own = found[thread];
    const std::span<const std::uint32_t> tile = tile_of(t);
    search.find(tile, own.hits);
    places[t] = {thread, own.slots.size()};
    std::array<std::uint32_t, BoxTree::most_queries> counts;
    append_slots(own.hits.get(), options.limit, counts, own.slots);
    for (std::size_t k = 0; k < tile.size(); ++k) result.offsets[tile[k] + 1] = counts[k];
    const std::size_t count = own.slots.size() - places[t].first;
    if (options.count_only) own.slots.clear();
    if ((total += count) > options.most_hits) throw_too_many_hits(options.most_hits);
  });
  for (std::size_t k = 0; k < n; ++k) result.offsets[k + 1] += result.offsets[k];
  if (options.count_only) return result;
  result.ids.reserve(total);
  use_large_pages(result.ids.data(), total * sizeof(std::uint32_t));
  result.ids.resize(total);
  parallel_for(tiles, threads, [&](std::size_t t, std::size_t /*thread*/) {
    auto next = found[places[t].thread].slots.begin() + static_cast<std::ptrdiff_t>(places[t].first);
    for (const std::uint32_t query : tile_of(t)) {
      const std::uint64_t first = result.offsets[query];
      const auto count = static_cast<std::ptrdiff_t>(result.offsets[query + 1] - first);
      std::copy(next, next + count, result.ids.begin() + static_cast<std::ptrdiff_t>(first));
      next += count;
    }
  });
  return result;
}

/// The same for one. If this throws, the ids are as before.
template <class Box>
std::size_t search(const Searched<Box>& in, const Box& query, const QueryOptions& options,
                   std::vector<std::uint32_t>& ids) {
  const TiledQueries<Box> search(in, std::span(&query, 1), options);
  HitList hits;
  constexpr std::array<std::uint32_t, 1> only{0};
  search.find(only, hits);
  const std::span<Hit> found = hits.get();
  const std::size_t count = std::min<std::size_t>(found.size(), options.limit);
  if (count > options.most_hits) throw_too_many_hits(options.most_hits);
  ids.resize(options.count_only ? 0 : found.size());
  if (options.count_only) return count;
  std::ranges::transform(found, ids.begin(), &Hit::slot);
  sort_slots(ids);
  ids.resize(count);
  return count;
}

}  // namespace

template <class Box>
Hits Queries<Box>::overlapping(const BoxView& boxes, const QueryOptions& options) {
  refuse_options(options, boxes.size());
  core_.refuse_forked();
  const std::vector<Box> packed = packed_boxes<Box>(boxes, "", threads_);
  return with_current(packed.size(), [&](const Searched<Box>& in) {
    if (packed.size() * unread_count() <= tests_per_read * core_.ids())
      return search(in, std::span<const Box>(packed), options);
    // (The tree cannot read anything now.)
    Core<Box> copy(make_sweep_and_prune({.threads = threads_}), threads_);
    core_.copy_to(copy);
    return Queries(copy, threads_).overlapping(boxes, options);
  });
}

template <class Box>
std::size_t Queries<Box>::overlapping(const Box& box, std::vector<std::uint32_t>& ids,
                                      const QueryOptions& options) {
  if (has_nan(box)) throw_nan("the box");
  return with_current(1, [&](const Searched<Box>& in) { return search(in, pack(box), options, ids); });
}

/// Calls a function with what is to be searched.
template <class Box>
template <class Function>
auto Queries<Box>::with_current(std::size_t queries, const Function& function) {
  core_.refuse_forked();
  std::shared_lock shared(mutex_);
  while (!is_current_ || must_read(queries)) {
    shared.unlock();
    {
      const std::unique_lock unique(mutex_);
      if (!is_current_ || must_read(queries)) find_unread(queries);
    }
    shared.lock();
  }
  const bool all = !unread_;
  scanned_.fetch_add(queries * unread_count(), std::memory_order_relaxed);
  return function(Searched<Box>{.core = core_,
                                .tree = all ? nullptr : tree_,
                                .unread = all ? std::span<const std::uint32_t>() : *unread_,
                                .unread_set = unread_set_,
                                .threads = threads_});
}

/// Whether testing what is not in the tree would have taken as long as reading it.
template <class Box>
bool Queries<Box>::must_read(std::size_t queries) const noexcept {
  const std::size_t unread = unread_count();
  return unread > 0 && scanned_ + queries * unread > tests_per_read * unread && core_.can_read();
}

/// Finds what is not in the tree, and reads it if it is time.
template <class Box>
void Queries<Box>::find_unread(std::size_t queries) {
  is_current_ = false;  // until all is done
  tree_ = &core_.choose_tree();
  unread_ = core_.unread();
  if (must_read(queries)) {
    core_.read();
    scanned_ = 0;
    unread_.emplace();
  }
  unread_set_ = SlotSet(unread_ ? *unread_ : std::span<const std::uint32_t>());
  is_current_ = true;
}

template <class Box>
std::vector<std::uint32_t> Queries<Box>::partners(std::uint32_t id) {
  (void)core_.filter(id);  // refuses unknown ids
  std::shared_lock shared(mutex_);
  while (!has_pairs_) {
    shared.unlock();
    {
      const std::unique_lock unique(mutex_);
      if (!has_pairs_) index_pairs();
    }
    shared.lock();
  }
  std::vector<std::uint32_t> partners;
  for (auto pair = std::ranges::lower_bound(pairs_, id, {}, &Pair::b); pair != pairs_.end() && pair->b == id;
       ++pair) {
    partners.push_back(pair->a);
  }
  if (id + std::size_t{2} < first_larger_.size()) {
    partners.insert(partners.end(), larger_.begin() + first_larger_[id + std::size_t{1}],
                    larger_.begin() + first_larger_[id + std::size_t{2}]);
  }
  return partners;
}

/// Lists the larger partners of each id. (The smaller ones are together in the list of pairs.)
template <class Box>
void Queries<Box>::index_pairs() {
  pairs_ = core_.pairs();
  first_larger_.assign(pairs_.empty() ? 0 : pairs_.back().b + std::size_t{2}, 0);
  larger_.resize(pairs_.size());
  for (const Pair& pair : pairs_) ++first_larger_[pair.a + std::size_t{1}];
  std::partial_sum(first_larger_.begin(), first_larger_.end(), first_larger_.begin());
  for (std::size_t k = pairs_.size(); k-- > 0;)
    larger_[--first_larger_[pairs_[k].a + std::size_t{1}]] = pairs_[k].b;
  has_pairs_ = true;
}

template <class Box>
void Queries<Box>::shrink() noexcept {
  forget_pairs();
  unread_.reset();
  free_lists(pairs_, first_larger_, larger_);
}

template class Queries<Aabb>;
template class Queries<Aabb64>;

}  // namespace broadcl
