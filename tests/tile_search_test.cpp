#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <iterator>
#include <new>
#include <numeric>
#include <random>
#include <type_traits>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "base/coordinate_map.hpp"
#include "base/distance.hpp"
#include "base/moving_box.hpp"
#include "base/pair_lists.hpp"
#include "base/parallel.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "finders/pair_sort.hpp"
#include "finders/ranked_search.hpp"
#include "finders/tile_search.hpp"
#include "near.hpp"

/// The parts of sweep and prune.
namespace broadcl::test {
namespace {

template <std::size_t axes>
Aabb aabb_of(const Bounds<axes>& box) {
  return {{box.lower[0], box.lower[1], box.lower[2]}, {box.upper[0], box.upper[1], box.upper[2]}};
}

/// Tiles of random boxes, in nodes that touch the next one along the first axis, the last of them first in
/// the sweep. Every seventh box is missing. With reaches, bounds are those of grown boxes. Along the fourth
/// axis, if there is one, boxes are at four positions; those of every other tile at the same one.
template <std::size_t axes>
HostTiles<axes> random_tiles(std::size_t tiles, bool reaches = false) {
  std::mt19937 random(7);
  std::uniform_int_distribution<int> coordinate(0, 9);  // so that bounds often touch
  const Bounds<axes> none = make_bounds<axes>(nan_value, nan_value);
  Node<axes> empty;
  for (std::size_t k = 0; k < node_size; ++k) empty.set(k, none, 0);
  HostTiles<axes> all;
  all.reaches = reaches;
  all.boxes.resize(reaches ? tiles : 0);
  all.nodes.assign((tiles + node_size - 1) / node_size, empty);
  all.roots.assign(1, empty);
  all.tops.assign(1, empty);
  Bounds<axes> of_all = make_bounds<axes>(infinity, -infinity);
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    Bounds<axes> bounds = make_bounds<axes>(infinity, -infinity);
    Node<axes>& node = all.tiles.emplace_back();
    for (std::size_t k = 0; k < node_size; ++k) {
      Bounds<axes> box = none;
      for (std::size_t axis = 0; k % 7 != 3 && axis < 3; ++axis) {
        box.lower[axis] = static_cast<float>(coordinate(random));
        const std::size_t position = tile / node_size;
        if (axis == 0) box.lower[0] -= 9 * static_cast<float>(position);
        box.upper[axis] = box.lower[axis] + static_cast<float>(axis);
      }
      if constexpr (axes > 3) {
        if (k % 7 != 3)
          box.lower[3] = box.upper[3] = static_cast<float>((tile % 2 == 0 ? tile / 2 : tile + k) % 4);
      }
      if (reaches) {
        const float reach = static_cast<float>(std::max(0, coordinate(random) - 6)) / 2;
        all.boxes[tile].set(k, aabb_of(box), reach);
        box = grown(box, reach);
      }
      node.set(k, box, static_cast<std::uint32_t>(tile * node_size + k));
      extend(bounds, box);
    }
    all.bounds.push_back(bounds);
    all.nodes[tile / node_size].set(tile % node_size, bounds, static_cast<std::uint32_t>(tile));
  }
  for (std::uint32_t k = 0; k < all.nodes.size(); ++k) {
    Bounds<axes> bounds = make_bounds<axes>(infinity, -infinity);
    for (std::size_t child = 0; child < node_size; ++child) extend(bounds, all.nodes[k].get(child));
    all.roots[0].set(k, bounds, k);
    extend(of_all, bounds);
    all.sweep.insert(all.sweep.begin(), k);
  }
  all.tops[0].set(0, of_all, 0);
  return all;
}

Pairs to_pairs(const Found& found) {
  std::vector<std::span<const Pair>> lists;
  found.get(lists);
  Pairs pairs;
  for (const std::span<const Pair> list : lists) pairs.insert(pairs.end(), list.begin(), list.end());
  return pairs;
}

Pairs sorted(const Found& found) {
  Pairs pairs = to_pairs(found);
  std::ranges::sort(pairs);
  return pairs;
}

/// Whether two boxes may pair by their positions along the fourth axis: in the same world, or in the other
/// set of it.
template <std::size_t axes>
bool positions_pair(const HostTiles<axes>& all, const Bounds<axes>& s, const Bounds<axes>& t) {
  if constexpr (axes > 3) {
    const auto position = [](const Bounds<axes>& box) { return static_cast<unsigned>(box.lower[3]); };
    return position(s) == (position(t) ^ (all.sets ? 1U : 0U));
  }
  return true;
}

/// The pairs by the definition.
template <std::size_t axes>
Pairs expected_pairs(const HostTiles<axes>& all, const std::vector<Filter>& filters) {
  Pairs pairs;
  const auto box_of = [&](std::uint32_t slot) { return all.tiles[slot / node_size].get(slot % node_size); };
  const auto are_together = [&](std::uint32_t a, std::uint32_t b) {
    if (!all.reaches) return overlaps(aabb_of(box_of(a)), aabb_of(box_of(b)));
    const TileBoxes& s = all.boxes[a / node_size];
    const TileBoxes& t = all.boxes[b / node_size];
    return are_near(s.get(a % node_size), t.get(b % node_size), s.reach[a % node_size],
                    t.reach[b % node_size]);
  };
  for (std::uint32_t b = 0; b < all.tiles.size() * node_size; ++b) {
    for (std::uint32_t a = 0; a < b; ++a) {
      const Bounds<axes> s = box_of(a);
      const Bounds<axes> t = box_of(b);
      if (are_together(a, b) && positions_pair(all, s, t) &&
          (filters.empty() || may_pair(filters[a], filters[b]))) {
        pairs.push_back({a, b});
      }
    }
  }
  return pairs;
}

template <std::size_t axes>
void expect_same_pairs(HostTiles<axes> all) {
  std::vector<std::uint32_t> places(all.tiles.size() * node_size);
  std::iota(places.begin(), places.end(), 0U);
  std::vector<Aabb> boxes;
  std::vector<float> reaches;
  std::vector<Filter> positions;
  for (const std::uint32_t place : places) {
    const std::size_t k = place % node_size;
    const Bounds<axes> box = all.tiles[place / node_size].get(k);
    boxes.push_back(all.reaches ? all.boxes[place / node_size].get(k) : aabb_of(box));
    if (all.reaches) reaches.push_back(all.boxes[place / node_size].reach[k]);
    if constexpr (axes > 3) {
      const auto position = static_cast<std::uint32_t>(std::max(0.0F, box.lower[3]));
      positions.push_back(all.sets ? Filter{.group = position % 2, .world = position / 2}
                                   : Filter{.world = position});
    }
  }
  const Input input{.boxes = boxes, .rules = {.filters = positions, .reaches = reaches, .sets = all.sets}};
  const auto group_of = [](std::uint32_t slot) {  // that of all slots of some tiles, and of the second node
    const std::uint32_t tile = slot / node_size;
    return tile / node_size == 1 ? 2U : 1U << (tile % 2 == 0 ? tile : slot) % 3;
  };
  for (const bool with_filters : {false, true}) {
    std::vector<Filter> filters;
    for (std::uint32_t k = 0; with_filters && k < places.size(); ++k)
      filters.push_back({.group = group_of(k), .mask = 5});
    all.node_filters.assign(all.nodes.size(), no_filter);
    for (std::size_t tile = 0; with_filters && tile < all.tiles.size(); ++tile) {
      all.tile_filters.push_back(filter_of(all.tiles[tile], filters));
      extend(all.node_filters[tile / node_size], all.tile_filters[tile]);
    }
    const Pairs expected = expected_pairs(all, filters);
    ASSERT_GT(expected.size(), 100U);
    for (const bool plain : {true, false}) {
      PairCount count{.count = 0, .most_stored = most_pairs};
      Found found;
      found.clear(count);
      for (std::size_t part = 0; part < all.nodes.size() * parts_per_node; ++part)
        tile_search<axes>(all.reaches, plain).tiles(found, all, part, filters);
      EXPECT_TRUE(same("of tiles", sorted(found), expected)) << plain;
      found.end();
      EXPECT_EQ(count.count, expected.size());
      for (const std::uint32_t part : {1U, 2U, 40U}) {  // every so many boxes changed
        const auto has_changed = [=](std::uint32_t slot) { return slot % part == 0 || slot % 320 == 7; };
        std::vector<std::uint32_t> changed(all.tiles.size());
        for (const std::uint32_t place : places)
          changed[place / node_size] |= (has_changed(place) ? 1U : 0U) << place % node_size;
        Found of_changed;
        of_changed.clear(count);
        for (std::size_t tile = 0; tile < all.tiles.size(); ++tile) {
          if (changed[tile] != 0)
            tile_search<axes>(all.reaches, plain).changed(of_changed, all, changed, tile, filters);
        }
        Pairs pairs;
        std::ranges::copy_if(expected, std::back_inserter(pairs),
                             [&](const Pair& pair) { return has_changed(pair.a) || has_changed(pair.b); });
        EXPECT_TRUE(same("of those that changed", sorted(of_changed), pairs)) << plain << part;
      }
      Pairs unsorted{{0, 0}};
      HostTiles<axes> tiles;
      tiles.sets = all.sets;
      tiles.reaches = all.reaches;
      tile_search<axes>(all.reaches, plain).unsorted(unsorted, tiles, input, filters);
      EXPECT_TRUE(same("unsorted", unsorted, expected)) << plain;
    }
  }
}

TEST(Found, HoldsAsManyPairsAsThereAre) {
  PairCount count{.count = 0, .most_stored = most_pairs};
  Found found;
  EXPECT_TRUE(to_pairs(found).empty());
  for (const std::uint32_t n : {200000U, 1U, 65536U, 300000U}) {
    count.count = 0;
    found.clear(count);
    Pairs expected;
    for (std::uint32_t k = 0; k < n; ++k) {
      if (k % 7 == 0) found.reserve(7);
      expected.push_back({k, k + n});
      *found.next() = expected.back();
      found.set_next(found.next() + 1);
    }
    EXPECT_TRUE(same("pairs", to_pairs(found), expected));
    found.end();
    EXPECT_EQ(count.count, n);
  }
}

TEST(Found, CountsOnlyWhatIsTooMuchToStore) {
  PairCount count{.count = 0, .most_stored = 100'000};
  std::vector<Found> found(2);
  for (Found& one : found) one.clear(count);
  for (std::uint32_t k = 0; k < 1'000'000; ++k) {
    Found& one = found.at(k % 2);
    one.reserve(1);
    *one.next() = {k, k + 1};
    one.set_next(one.next() + 1);
  }
  for (Found& one : found) {
    one.end();
    EXPECT_LT(to_pairs(one).size(), 200'000U);
  }
  EXPECT_EQ(count.count, 1'000'000U);
}

TEST(TileSearch, ForEachProcessorFindsTheSamePairs) {
  expect_same_pairs(random_tiles<3>(9));
  expect_same_pairs(random_tiles<3>(2 * node_size + 5));
  expect_same_pairs(random_tiles<3>(2 * node_size + 5, true));
}

TEST(TileSearch, ForEachProcessorFindsTheSamePairsOfWorldsAndSets) {
  for (const bool reaches : {false, true}) {
    HostTiles<4> all = random_tiles<4>(2 * node_size + 5, reaches);
    expect_same_pairs(all);
    all.sets = true;
    expect_same_pairs(all);
  }
}

/// All boxes with keys up to a limit, as the functions for one box find them.
template <class Box, std::size_t axes>
void expect_ranked(const HostTiles<axes>& all) {
  using Bound = BoundType<Box>;
  using Hits = std::vector<std::pair<Bound, std::uint32_t>>;
  struct Search final : RankedSearch<Box> {
    void take(std::uint32_t slot, Bound key) override { hits.emplace_back(key, slot); }
    Hits hits;
  };
  const CoordinateMap rounds;
  const auto bounds = [](const auto& corner) {
    return std::array<Bound, 3>{static_cast<Bound>(corner[0]), static_cast<Bound>(corner[1]),
                                static_cast<Bound>(corner[2])};
  };
  const MovingBox<Box> moving{
      .box = {{-1, 2, 3}, {0, 2, 4}}, .reciprocals = {Bound(0.5), -1, 0}, .length = 20};
  for (const bool moves : {false, true}) {
    Hits expected;
    for (std::uint32_t slot = 0; slot < all.tiles.size() * node_size; ++slot) {
      Aabb box = aabb_of(all.tiles[slot / node_size].get(slot % node_size));
      if (has_nan(box)) continue;
      if (all.reaches) box = all.boxes[slot / node_size].get(slot % node_size);
      const Box other{bounds(box.lower), bounds(box.upper)};
      if (!moves) {
        const Bound key = squared_distance(moving.box, other);
        if (key <= 50) expected.emplace_back(key, slot);
      } else if (const auto time = time_of_meeting(moving, other)) {
        expected.emplace_back(*time, slot);
      }
    }
    std::ranges::sort(expected);
    EXPECT_GT(expected.size(), 2U);
    for (const bool plain : {false, true}) {
      for (const bool limited : {false, true}) {
        Search search;
        search.box = moving.box;
        search.moving = moves ? &moving : nullptr;
        search.most = moves ? moving.length : 50;
        search.is_limited = limited;
        search.map = &rounds;
        ranked_tile_search<axes, Box>(plain)(search, all);
        std::ranges::sort(search.hits, {}, [](const auto& hit) { return hit.second; });
        auto in_order = expected;
        std::ranges::sort(in_order, {}, [](const auto& hit) { return hit.second; });
        if constexpr (std::is_same_v<Box, Aabb>) {
          EXPECT_EQ(search.hits, in_order) << moves << plain << limited;
        } else {  // bounds are rounded outward, so there may be more, and no key is greater
          auto found = search.hits.begin();
          for (const auto& [key, slot] : in_order) {
            while (found != search.hits.end() && found->second < slot) ++found;
            ASSERT_TRUE(found != search.hits.end() && found->second == slot && found->first <= key);
            EXPECT_NEAR(found->first, key, 1e-3);
          }
        }
      }
    }
  }
}

TEST(RankedSearch, ForEachProcessorFindsTheSame) {
  for (const bool reaches : {false, true}) {
    expect_ranked<Aabb>(random_tiles<3>(2 * node_size + 5, reaches));
    expect_ranked<Aabb64>(random_tiles<3>(2 * node_size + 5, reaches));
    expect_ranked<Aabb>(random_tiles<4>(2 * node_size + 5, reaches));
    expect_ranked<Aabb64>(random_tiles<4>(9, reaches));
  }
}

TEST(PairSort, AListThatGrowsStepByStepIsSeldomReplaced) {
  std::vector<Pair> pairs;
  std::vector<const Pair*> places;
  for (std::size_t n = 600000; n < 1200000; n += n / 200) {
    resize_for_writing(pairs, n);
    ASSERT_EQ(pairs.size(), n);
    if (places.empty() || places.back() != pairs.data()) places.push_back(pairs.data());
  }
  EXPECT_LE(places.size(), 4U);
}

TEST(PairSort, ListsOfAnyLengthAndWidth) {
  std::mt19937_64 random(3);
  PairSort sort;
  Pairs sorted;
  for (const std::uint64_t slots :
       {2ULL, 3ULL, 255ULL, 256ULL, 1000ULL, 70'000ULL, 1ULL << 24U, 1ULL << 31U}) {
    for (const std::size_t n : {0U, 1U, 200U, 5000U, 60'000U, 300'000U}) {
      if (n > 60'000 && slots > 1000) continue;  // all would be in few partitions
      Pairs pairs(n);
      for (Pair& pair : pairs) {
        pair = {static_cast<std::uint32_t>(random() % slots), static_cast<std::uint32_t>(random() % slots)};
      }
      const std::span<const Pair> all = pairs;
      const std::array lists{all.first(n / 3), all.subspan(n / 3, 0), all.subspan(n / 3)};
      sort(lists, slots, 1 + n % 4, sorted);
      std::ranges::sort(pairs);
      ASSERT_TRUE(same("sorted", sorted, pairs)) << n << " of " << slots;
    }
  }
}

TEST(ParallelFor, CallsOnceForEachAndPassesErrorsOn) {
  for (const std::size_t threads : {1U, 3U, 100U}) {
    std::vector<std::atomic<int>> calls(1000);
    parallel_for(calls.size(), threads, [&](std::size_t k, std::size_t thread) {
      EXPECT_LT(thread, threads);
      ++calls[k];
    });
    EXPECT_TRUE(std::ranges::all_of(calls, [](const auto& count) { return count == 1; }));
    EXPECT_THROW(parallel_for(calls.size(), threads,
                              [](std::size_t k, std::size_t /*thread*/) {
                                if (k == 500) throw std::bad_alloc();
                              }),
                 std::bad_alloc);
  }
  parallel_for(0, 4, [](std::size_t /*k*/, std::size_t /*thread*/) { FAIL(); });
}

}  // namespace
}  // namespace broadcl::test
