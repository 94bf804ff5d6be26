#include "finders/tile_search.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "base/distance.hpp"
#include "base/lanes.hpp"
#include "base/packed_box.hpp"
#include "engines/box_tree.hpp"
#include "finders/slot_bounds.hpp"

namespace broadcl {
namespace {

// The following functions are compiled twice, so they must be inlined. They are vectorised by hand, since GCC
// does it with -O3 only.

constexpr std::array<std::uint32_t, node_size> bit_of = [] {
  std::array<std::uint32_t, node_size> bits{};
  for (std::size_t k = 0; k < node_size; ++k) bits[k] = 1U << k;
  return bits;
}();

BROADCL_INLINE std::size_t lowest_bit(std::uint32_t bits) {
  return static_cast<std::size_t>(std::countr_zero(bits));
}

/// One bit per child of a node: whether it overlaps these bounds along the first axes.
template <class Lanes, std::size_t tested, std::size_t axes>
BROADCL_INLINE std::uint32_t overlapping_along(const Node<axes>& node, const Bounds<axes>& bounds) {
  using Bits = decltype(Lanes{} <= Lanes{});
  constexpr std::size_t lanes = sizeof(Lanes) / sizeof(float);
  const Node<axes>* children = &node;
  asm("" : "+r"(children));  // so that GCC does not copy them to the stack before a loop of few rounds
  Bits of_lanes;
  std::memcpy(&of_lanes, bit_of.data(), sizeof of_lanes);
  Bits bits{};
#pragma GCC unroll 8
  for (std::size_t k = node_size; k > 0;) {
    k -= lanes;
    Bits overlaps = of_lanes;
#pragma GCC unroll 4
    for (std::size_t axis = 0; axis < tested; ++axis) {
      Lanes lower;
      Lanes upper;
      std::memcpy(&lower, &children->lower[axis][k], sizeof lower);
      std::memcpy(&upper, &children->upper[axis][k], sizeof upper);
      overlaps &= (lower <= bounds.upper[axis]) & (bounds.lower[axis] <= upper);  // detail::meet() of lanes
    }
    bits = bits << int{lanes} | overlaps;
  }
  std::uint32_t all = 0;
#pragma GCC unroll 8
  for (std::size_t lane = 0; lane < lanes; ++lane) all |= static_cast<std::uint32_t>(bits[lane]);
  return all;
}

template <class Lanes, std::size_t axes>
BROADCL_INLINE std::uint32_t overlapping(const Node<axes>& node, const Bounds<axes>& bounds) {
  return overlapping_along<Lanes, axes>(node, bounds);
}

/// The bounds to search for a box or tile with these bounds. With two sets, those of the other set in the
/// same world; if the tile has several sets or worlds, all sets of its worlds.
template <std::size_t axes>
BROADCL_INLINE Bounds<axes> target_of(const HostTiles<axes>& all, Bounds<axes> bounds) {
  if constexpr (axes > 3) {
    if (!all.sets) return bounds;
    const bool is_one = bounds.lower[3] == bounds.upper[3];
    const float first = 2 * std::floor(bounds.lower[3] / 2);
    const float last = 2 * std::floor(bounds.upper[3] / 2) + 1;
    const bool is_first = bounds.lower[3] == first;
    bounds.lower[3] = is_one && is_first ? last : first;
    bounds.upper[3] = is_one && !is_first ? first : last;
  }
  return bounds;
}

/// Boxes of a tile and their reaches, which are 0 if `reach` is null.
struct TileColumns {
  const std::array<float, node_size>* lower;
  const std::array<float, node_size>* upper;
  const float* reach;

  [[nodiscard]] Aabb get(std::size_t k) const {
    return {{lower[0][k], lower[1][k], lower[2][k]}, {upper[0][k], upper[1][k], upper[2][k]}};
  }
};
BROADCL_INLINE TileColumns columns_of(const TileBoxes& boxes) {
  return {boxes.lower.data(), boxes.upper.data(), boxes.reach.data()};
}

/// Those of some boxes of a tile, a bit for each, that are within the sum of the reaches of a box of another
/// tile: is_within(). All of them are proper.
template <class Lanes>
BROADCL_INLINE std::uint32_t within_reach(const TileColumns& tile, std::uint32_t bits, const Aabb& other,
                                          float reach_of_other) {
  using Bits = decltype(Lanes{} <= Lanes{});
  constexpr std::size_t lanes = sizeof(Lanes) / sizeof(float);
  constexpr float least = least_distance<float>;
  Bits of_lanes;
  std::memcpy(&of_lanes, bit_of.data(), sizeof of_lanes);
  Bits near{};
  for (std::size_t k = node_size; k > 0;) {
    k -= lanes;
    Lanes squared{};
#pragma GCC unroll 3
    for (std::size_t axis = 0; axis < 3; ++axis) {
      Lanes lower;
      Lanes upper;
      std::memcpy(&lower, &tile.lower[axis][k], sizeof lower);
      std::memcpy(&upper, &tile.upper[axis][k], sizeof upper);
      const Lanes above = lower - other.upper[axis];  // NaN, as the other one, if both are infinite
      const Lanes below = other.lower[axis] - upper;
      Lanes gap = above > below ? above : below;
      gap = gap >= least ? gap : Lanes{};
      squared += gap * gap;
    }
    Lanes reach{};
    if (tile.reach != nullptr) std::memcpy(&reach, &tile.reach[k], sizeof reach);
    reach += reach_of_other;
    near = near << int{lanes} | ((squared <= reach * reach) & of_lanes);
  }
  std::uint32_t all = 0;
#pragma GCC unroll 8
  for (std::size_t lane = 0; lane < lanes; ++lane) all |= static_cast<std::uint32_t>(near[lane]);
  bits &= all;
  if (reach_of_other >= least) return bits;
  for (std::uint32_t rest = bits; rest != 0; rest &= rest - 1) {
    const std::size_t k = lowest_bit(rest);
    const float reach = (tile.reach != nullptr ? tile.reach[k] : 0) + reach_of_other;
    if (reach < least && !packed_overlaps(tile.get(k), other)) bits ^= bit_of[k];
  }
  return bits;
}

/// Stores the pairs of a box of a tile with some boxes of another tile, `t`.
/// @returns Where the next pair is to be stored.
template <class Lanes, bool reaches, std::size_t axes>
BROADCL_INLINE Pair* store_found(Pair* next, const HostTiles<axes>& all, std::size_t t, std::uint32_t bits,
                                 std::size_t s, std::size_t k, std::span<const Filter> filters) {
  const Node<axes>& tile = all.tiles[t];
  const std::uint32_t other = all.tiles[s].index[k];
  if (reaches && bits != 0)
    bits = within_reach<Lanes>(columns_of(all.boxes[t]), bits, all.boxes[s].get(k), all.boxes[s].reach[k]);
  for (; bits != 0; bits &= bits - 1) {
    const std::uint32_t slot = tile.index[lowest_bit(bits)];
    if (!filters.empty() && !may_pair(filters[slot], filters[other])) continue;
    const std::uint32_t smaller = std::min(slot, other);
    *next++ = {smaller, slot ^ other ^ smaller};  // std::max() would be a branch
  }
  return next;
}

/// Tests the boxes of two tiles. Along axes that are not tested, all of them overlap.
template <class Lanes, bool reaches, std::size_t tested, std::size_t axes>
BROADCL_INLINE void test_along(Found& found, const HostTiles<axes>& all, std::size_t s, std::size_t t,
                               std::span<const Filter> filters) {
  const auto target = [&](const Bounds<axes>& bounds) {
    return tested < axes ? bounds : target_of(all, bounds);
  };
  const std::uint32_t of_s = overlapping_along<Lanes, tested>(all.tiles[s], target(all.bounds[t]));
  if (of_s == 0) return;
  const std::uint32_t of_t = overlapping_along<Lanes, tested>(all.tiles[t], target(all.bounds[s]));
  const bool is_s_smaller = std::popcount(of_s) < std::popcount(of_t);
  const std::size_t smaller = is_s_smaller ? s : t;
  const std::size_t larger = is_s_smaller ? t : s;
  const std::uint32_t of_larger = is_s_smaller ? of_t : of_s;
  Pair* next = found.next();
  for (std::uint32_t bits = is_s_smaller ? of_s : of_t; bits != 0; bits &= bits - 1) {
    const auto k = lowest_bit(bits);
    const std::uint32_t found_in_larger =
        reaches && tested == 3  // these are tested anyway
            ? of_larger
            : overlapping_along<Lanes, tested>(all.tiles[larger], target(all.tiles[smaller].get(k)));
    next = store_found<Lanes, reaches>(next, all, larger, found_in_larger, smaller, k, filters);
  }
  found.set_next(next);
}

/// Tests the boxes of two tiles, one of which overlaps the target of the other.
template <class Lanes, bool reaches, std::size_t axes>
BROADCL_INLINE void test(Found& found, const HostTiles<axes>& all, std::size_t s, std::size_t t,
                         std::span<const Filter> filters) {
  if constexpr (axes > 3) {
    // If each tile is at a single position along the fourth axis, the two positions were compared already.
    const auto is_flat = [](const Bounds<axes>& bounds) { return bounds.lower[3] == bounds.upper[3]; };
    if (is_flat(all.bounds[s]) && is_flat(all.bounds[t]))
      return test_along<Lanes, reaches, 3>(found, all, s, t, filters);
  }
  test_along<Lanes, reaches, axes>(found, all, s, t, filters);
}

/// Tests the boxes of a tile with each other.
template <class Lanes, bool reaches, std::size_t axes>
BROADCL_INLINE void test_itself(Found& found, const HostTiles<axes>& all, std::size_t s,
                                std::span<const Filter> filters) {
  if (!packed_overlaps<axes>(all.bounds[s], target_of(all, all.bounds[s]))) return;  // they are of one set
  const Node<axes>& tile = all.tiles[s];
  Pair* next = found.next();
  for (std::size_t k = 1; k < node_size; ++k) {
    const std::uint32_t bits = overlapping<Lanes>(tile, target_of(all, tile.get(k))) & (bit_of[k] - 1);
    next = store_found<Lanes, reaches>(next, all, s, bits, s, k, filters);
  }
  found.set_next(next);
}

/// Tests some tiles of a node with tiles of a node that is not earlier in the sweep.
/// @param tiles One bit per tile.
template <class Lanes, bool reaches, std::size_t axes>
BROADCL_INLINE void test_nodes(Found& found, const HostTiles<axes>& all, std::size_t own, std::uint32_t tiles,
                               std::size_t other, std::span<const Filter> filters) {
  constexpr std::size_t most = node_size * node_size;  // pairs of two tiles
  const auto tiles_may_pair = [&](std::size_t s, std::size_t t) {
    return all.tile_filters.empty() || may_pair(all.tile_filters[s], all.tile_filters[t]);
  };
  for (; tiles != 0; tiles &= tiles - 1) {
    const std::size_t child = lowest_bit(tiles);
    const std::size_t s = own * node_size + child;
    std::uint32_t others = overlapping<Lanes>(all.nodes[other], target_of(all, all.bounds[s]));
    if (own == other) {
      found.reserve(most);
      if (tiles_may_pair(s, s)) test_itself<Lanes, reaches>(found, all, s, filters);
      others &= 0xfffffffeU << child;
    }
    for (; others != 0; others &= others - 1) {
      const std::size_t t = other * node_size + lowest_bit(others);
      if (!tiles_may_pair(s, t)) continue;
      found.reserve(most);
      ++found.work;
      test<Lanes, reaches>(found, all, s, t, filters);
    }
  }
}

template <class Lanes, bool reaches, std::size_t axes>
BROADCL_INLINE void search_tiles(Found& found, const HostTiles<axes>& all, std::size_t part,
                                 std::span<const Filter> filters) {
  constexpr std::size_t tiles_per_part = node_size / parts_per_node;
  constexpr std::uint32_t first_part = (1U << tiles_per_part) - 1;
  const std::size_t position = part / parts_per_node;
  const std::uint32_t tiles = first_part << part % parts_per_node * tiles_per_part;
  const auto bounds_of = [&](std::size_t node) { return all.roots[node / node_size].get(node % node_size); };
  const std::size_t own = all.sweep[position];
  const Bounds<axes> bounds = target_of(all, bounds_of(own));
  for (const std::uint32_t other : std::span(all.sweep).subspan(position)) {
    const Bounds<axes> others = bounds_of(other);
    if (others.lower[all.axis] > bounds.upper[all.axis]) break;
    if (!packed_overlaps<axes>(others, bounds)) continue;
    if (!all.tile_filters.empty() && !may_pair(all.node_filters[own], all.node_filters[other])) continue;
    test_nodes<Lanes, reaches>(
        found, all, own, overlapping<Lanes>(all.nodes[own], target_of(all, others)) & tiles, other, filters);
  }
}

/// Calls function(tile) for tiles whose bounds, and those of the nodes above, are not culled.
/// @param select Returns a bit for each child of a node that is not.
template <std::size_t axes, class Select, class Function>
BROADCL_INLINE void visit(const HostTiles<axes>& all, const Select& select, const Function& function) {
  for (std::size_t top = 0; top < all.tops.size(); ++top) {
    std::uint32_t roots = all.roots.size() > 1 ? select(all.tops[top]) : 1;
    for (; roots != 0; roots &= roots - 1) {
      const std::size_t root = top * node_size + lowest_bit(roots);
      for (std::uint32_t nodes = select(all.roots[root]); nodes != 0; nodes &= nodes - 1) {
        const std::size_t node = root * node_size + lowest_bit(nodes);
        for (std::uint32_t tiles = select(all.nodes[node]); tiles != 0; tiles &= tiles - 1)
          function(node * node_size + lowest_bit(tiles));
      }
    }
  }
}

/// Tests boxes of a tile that changed with all others, but with those that changed in earlier tiles.
template <class Lanes, bool reaches, std::size_t axes>
BROADCL_INLINE void search_changed(Found& found, const HostTiles<axes>& all,
                                   std::span<const std::uint32_t> changed, std::size_t s,
                                   std::span<const Filter> filters) {
  const Node<axes>& own = all.tiles[s];
  const std::uint32_t of_own = changed[s];
  Bounds<axes> hull = own.get(lowest_bit(of_own));
  for (std::uint32_t bits = of_own & (of_own - 1); bits != 0; bits &= bits - 1)
    extend(hull, own.get(lowest_bit(bits)));
  hull = target_of(all, hull);
  const auto test_with = [&](std::size_t t) {
    const Node<axes>& tile = all.tiles[t];
    const std::uint32_t of_tile = overlapping<Lanes>(tile, hull) & (t < s ? ~changed[t] : ~0U);
    ++found.work;
    if (of_tile == 0) return;
    found.reserve(node_size * node_size);
    Pair* next = found.next();
    const auto store = [&](std::size_t others, std::uint32_t hits, std::size_t with, std::size_t k) {
      next = store_found<Lanes, reaches>(next, all, others, hits, with, k, filters);
    };
    if (t == s) {
      for (std::uint32_t bits = of_own; bits != 0;
           bits &= bits - 1) {  // those not in `bits` have had their turn
        const std::size_t k = lowest_bit(bits);
        store(s, overlapping<Lanes>(own, target_of(all, own.get(k))) & ~bits, s, k);
      }
    } else if ((of_own & (of_own - 1)) == 0) {
      store(t, of_tile, s, lowest_bit(of_own));
    } else {
      const std::uint32_t hit = overlapping<Lanes>(own, target_of(all, all.bounds[t])) & of_own;
      const bool is_own_smaller = std::popcount(hit) < std::popcount(of_tile);
      const std::size_t smaller = is_own_smaller ? s : t;
      const std::size_t larger = is_own_smaller ? t : s;
      const std::uint32_t of_larger = is_own_smaller ? of_tile : hit;
      for (std::uint32_t bits = is_own_smaller ? hit : of_tile; bits != 0; bits &= bits - 1) {
        const std::size_t k = lowest_bit(bits);
        const Bounds<axes> target = target_of(all, all.tiles[smaller].get(k));
        store(larger, overlapping<Lanes>(all.tiles[larger], target) & of_larger, smaller, k);
      }
    }
    found.set_next(next);
  };
  visit<axes>(
      all, [&](const Node<axes>& node) { return overlapping<Lanes>(node, hull); }, test_with);
}

/// Tests some queries with all boxes.
template <class Lanes, bool reaches, std::size_t axes>
BROADCL_INLINE void search_queries(HitList& hits, const HostTiles<axes>& all,
                                   const QueryTile<axes>& queries) {
  const auto overlaps_hull = [&](const Node<axes>& node) { return overlapping<Lanes>(node, queries.hull); };
  visit<axes>(all, overlaps_hull, [&](std::size_t t) BROADCL_INLINE_LAMBDA {
    const Node<axes>& tile = all.tiles[t];
    const std::uint32_t of_tile = overlaps_hull(tile);
    if (of_tile == 0) return;
    const TileColumns boxes =
        all.reaches ? columns_of(all.boxes[t]) : TileColumns{tile.lower.data(), tile.upper.data(), nullptr};
    Hit* next = hits.reserve(node_size * node_size);
    const std::uint32_t of_queries =
        queries.size == 1 ? 1 : overlapping<Lanes>(queries.bounds, all.bounds[t]);
    if (std::popcount(of_queries) <= std::popcount(of_tile)) {
      for (std::uint32_t rest = of_queries; rest != 0; rest &= rest - 1) {
        const auto k = static_cast<std::uint32_t>(lowest_bit(rest));
        std::uint32_t bits = queries.size == 1 ? of_tile : overlapping<Lanes>(tile, queries.bounds.get(k));
        if (reaches && bits != 0)
          bits = within_reach<Lanes>(boxes, bits, queries.boxes.get(k), queries.boxes.reach[k]);
        for (; bits != 0; bits &= bits - 1) *next++ = {k, tile.index[lowest_bit(bits)]};
      }
    } else {
      for (std::uint32_t rest = of_tile; rest != 0; rest &= rest - 1) {
        const std::size_t k = lowest_bit(rest);
        std::uint32_t bits = overlapping<Lanes>(queries.bounds, tile.get(k));
        if (reaches && bits != 0) {
          bits = within_reach<Lanes>(columns_of(queries.boxes), bits, boxes.get(k),
                                     boxes.reach != nullptr ? boxes.reach[k] : 0);
        }
        for (; bits != 0; bits &= bits - 1)
          *next++ = {static_cast<std::uint32_t>(lowest_bit(bits)), tile.index[k]};
      }
    }
    hits.set_end(next);
  });
}

/// (A child whose bounds are NaN never grows less than another one.)
template <class Lanes, std::size_t axes>
BROADCL_INLINE std::size_t least_growth(std::span<const Node<axes>> nodes, const Bounds<axes>& box) {
  using Bits = decltype(Lanes{} <= Lanes{});
  constexpr std::size_t lanes = sizeof(Lanes) / sizeof(float);
  constexpr float of_worlds = 0x1p60F;
  Lanes least = Lanes{} + std::numeric_limits<float>::infinity();
  Bits best{};
  Bits child;
  for (std::size_t lane = 0; lane < lanes; ++lane) child[lane] = static_cast<std::int32_t>(lane);
  for (const Node<axes>& node : nodes) {
    for (std::size_t k = 0; k < node_size; k += lanes, child += lanes) {
      Lanes growth{};
#pragma GCC unroll 4
      for (std::size_t axis = 0; axis < axes; ++axis) {
        Lanes lower;
        Lanes upper;
        std::memcpy(&lower, &node.lower[axis][k], sizeof lower);
        std::memcpy(&upper, &node.upper[axis][k], sizeof upper);
        const Lanes more = (lower <= box.lower[axis] ? Lanes{} : lower - box.lower[axis]) +
                           (box.upper[axis] <= upper ? Lanes{} : box.upper[axis] - upper);
        growth += axis < 3 ? more : more * of_worlds;
      }
      const Bits is_less = growth < least;
      least = is_less ? growth : least;
      best = is_less ? child : best;
    }
  }
  std::size_t lane = 0;
  for (std::size_t other = 1; other < lanes; ++other) {
    if (least[other] < least[lane]) lane = other;
  }
  return static_cast<std::size_t>(best[lane]);
}

template <class Lanes, bool reaches, std::size_t axes>
BROADCL_INLINE void search_unsorted(std::vector<Pair>& pairs, HostTiles<axes>& all, const Input& input,
                                    std::span<const Filter> filters) {
  const auto slots = static_cast<std::uint32_t>(input.boxes.size());
  all.tiles.resize((slots + node_size - 1) / node_size);
  all.boxes.resize(reaches ? all.tiles.size() : 0);
  for (std::uint32_t slot = 0; slot < slots; ++slot) {
    const std::size_t k = slot % node_size;
    all.tiles[slot / node_size].set(k, bounds_of<axes>(input, slot), slot);
    if (reaches) all.boxes[slot / node_size].set(k, input.boxes[slot], input.rules.reaches[slot]);
  }
  std::array<Pair, node_size * node_size> found;
  Pair* next = found.data();
  const auto append = [&] { pairs.insert(pairs.end(), found.data(), std::exchange(next, found.data())); };
  pairs.clear();
  const std::span<const Node<axes>> tiles = all.tiles;
  for (std::uint32_t slot = 1; slot < slots; ++slot) {
    const std::size_t own = slot / node_size;
    const std::size_t k = slot % node_size;
    const Bounds<axes> target = target_of(all, tiles[own].get(k));
    for (std::size_t tile = 0; tile < own; ++tile) {
      next = store_found<Lanes, reaches>(next, all, tile, overlapping<Lanes>(tiles[tile], target), own, k,
                                         filters);
      if (next > &found[found.size() - 2 * node_size]) append();
    }
    const std::uint32_t before = overlapping<Lanes>(tiles[own], target) & (bit_of[k] - 1);
    next = store_found<Lanes, reaches>(next, all, own, before, own, k, filters);
  }
  append();
}

#if defined(__x86_64__) && defined(__GNUC__)
template <bool reaches, std::size_t axes>
[[gnu::target("avx2")]] void search_tiles_avx2(Found& found, const HostTiles<axes>& all, std::size_t part,
                                               std::span<const Filter> filters) {
  search_tiles<EightLanes, reaches>(found, all, part, filters);
}
template <bool reaches, std::size_t axes>
[[gnu::target("avx2")]] void search_changed_avx2(Found& found, const HostTiles<axes>& all,
                                                 std::span<const std::uint32_t> changed, std::size_t tile,
                                                 std::span<const Filter> filters) {
  search_changed<EightLanes, reaches>(found, all, changed, tile, filters);
}
template <bool reaches, std::size_t axes>
[[gnu::target("avx2")]] void search_queries_avx2(HitList& hits, const HostTiles<axes>& all,
                                                 const QueryTile<axes>& queries) {
  search_queries<EightLanes, reaches>(hits, all, queries);
}
template <std::size_t axes>
[[gnu::target("avx2")]] std::size_t least_growth_avx2(std::span<const Node<axes>> nodes,
                                                      const Bounds<axes>& box) {
  return least_growth<EightLanes>(nodes, box);
}
template <bool reaches, std::size_t axes>
[[gnu::target("avx2")]] void search_unsorted_avx2(std::vector<Pair>& pairs, HostTiles<axes>& all,
                                                  const Input& input, std::span<const Filter> filters) {
  search_unsorted<EightLanes, reaches>(pairs, all, input, filters);
}
#endif

template <bool reaches, std::size_t axes>
TileSearch<axes> search_with(bool plain) {
#if defined(__x86_64__) && defined(__GNUC__)
  if (!plain && __builtin_cpu_supports("avx2") != 0)
    return {search_tiles_avx2<reaches, axes>, search_changed_avx2<reaches, axes>,
            search_queries_avx2<reaches, axes>, least_growth_avx2<axes>, search_unsorted_avx2<reaches, axes>};
#else
  (void)plain;
#endif
  return {search_tiles<FourLanes, reaches, axes>, search_changed<FourLanes, reaches, axes>,
          search_queries<FourLanes, reaches, axes>, least_growth<FourLanes, axes>,
          search_unsorted<FourLanes, reaches, axes>};
}

}  // namespace

template <std::size_t axes>
TileSearch<axes> tile_search(bool reaches, bool plain) {
  return reaches ? search_with<true, axes>(plain) : search_with<false, axes>(plain);
}
template TileSearch<3> tile_search<3>(bool, bool);
template TileSearch<4> tile_search<4>(bool, bool);

}  // namespace broadcl
