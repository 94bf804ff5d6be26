#include "core/query_batch.hpp"

#include <algorithm>
#include <atomic>
#include <string>
#include <type_traits>

#include <broadcl/error.hpp>

#include "base/parallel.hpp"
#include "base/system.hpp"
#include "core/reach.hpp"

namespace broadcl {
namespace {

/// Fewer queries are not sorted.
constexpr std::size_t fewest_sorted = 2 * BoxTree::most_queries;
constexpr std::size_t queries_per_thread = 512;

}  // namespace

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

Hits collect_hits(std::span<const Aabb> boxes, const QueryOptions& options, const Threads& threads,
                  const std::function<void(std::span<const std::uint32_t>, FoundHits&)>& find) {
  const std::size_t n = boxes.size();
  const bool sorts = n >= fewest_sorted;
  std::vector<std::uint32_t> order;
  if (sorts) {
    const bool is_by_filter = options.filters.size() > 1;
    order = order_in_space(boxes, is_by_filter ? options.filters : std::span<const Filter>(), threads);
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
  struct alignas(cache_line) OfThread : FoundHits {};
  struct OfTile {
    std::size_t thread;
    std::size_t first;
  };
  const Threads useful = useful_threads(n, queries_per_thread, threads);
  std::vector<OfThread> found(useful.most);
  std::vector<OfTile> places(tiles);
  std::atomic<std::uint64_t> total = 0;
  Hits result;
  result.offsets.resize(n + 1);
  parallel_for(tiles, useful, [&](std::size_t t, std::size_t thread) {
    FoundHits& own = found[thread];
    const std::span<const std::uint32_t> tile = tile_of(t);
    places[t] = {thread, own.slots.size()};
    find(tile, own);
    for (std::size_t k = 0; k < tile.size(); ++k) result.offsets[tile[k] + 1] = own.counts.at(k);
    const std::size_t count = own.slots.size() - places[t].first;
    if (options.count_only) {
      own.slots.clear();
      own.keys.clear();
    }
    if ((total += count) > options.most_hits) throw_too_many_hits(options.most_hits);
  });
  for (std::size_t k = 0; k < n; ++k) result.offsets[k + 1] += result.offsets[k];
  if (options.count_only) return result;
  const auto gather = [&](auto& out, auto FoundHits::*list) {
    using Number = typename std::remove_reference_t<decltype(out)>::value_type;
    out.reserve(total);
    use_large_pages(out.data(), total * sizeof(Number));
    out.resize(total);
    parallel_for(tiles, useful, [&](std::size_t t, std::size_t /*thread*/) {
      auto next = (found[places[t].thread].*list).begin() + static_cast<std::ptrdiff_t>(places[t].first);
      for (const std::uint32_t query : tile_of(t)) {
        const std::uint64_t first = result.offsets[query];
        const auto count = static_cast<std::ptrdiff_t>(result.offsets[query + 1] - first);
        std::copy(next, next + count, out.begin() + static_cast<std::ptrdiff_t>(first));
        next += count;
      }
    });
  };
  gather(result.ids, &FoundHits::slots);
  if (std::ranges::any_of(found, [](const FoundHits& own) { return !own.keys.empty(); }))
    gather(result.squared_distances, &FoundHits::keys);
  return result;
}

}  // namespace broadcl
