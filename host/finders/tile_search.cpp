#include "finders/tile_search.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "base/lanes.hpp"
#include "base/packed_box.hpp"
#include "finders/slot_bounds.hpp"

namespace broadcl {
namespace {

// The following functions are compiled twice, for any processor and for those with AVX2, so they must be
// inlined. They are vectorised by hand, since GCC does it with -O3 only.
#define BROADCL_INLINE [[gnu::always_inline]] inline

#ifdef _WIN32  // where GCC aligns no more than 16 bytes on the stack
using EightLanes = FourLanes;
#else
using EightLanes [[gnu::vector_size(32)]] = float;
#endif

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

/// Stores the pairs of a box with some boxes of a tile.
/// @returns Where the next pair is to be stored.
template <std::size_t axes>
BROADCL_INLINE Pair* store_found(Pair* next, const Node<axes>& tile, std::uint32_t bits, std::uint32_t other,
                                 std::span<const Filter> filters) {
  for (; bits != 0; bits &= bits - 1) {
    const std::uint32_t slot = tile.index[lowest_bit(bits)];
    if (!filters.empty() && !may_pair(filters[slot], filters[other])) continue;
    const std::uint32_t smaller = std::min(slot, other);
    *next++ = {smaller, slot ^ other ^ smaller};  // std::max() would be a branch
  }
  return next;
}

/// Tests the boxes of two tiles. Along axes that are not tested, all of them overlap.
template <class Lanes, std::size_t tested, std::size_t axes>
BROADCL_INLINE void test_along(Found& found, const HostTiles<axes>& all, std::size_t s, std::size_t t,
                               std::span<const Filter> filters) {
  const auto target = [&](const Bounds<axes>& bounds) {
    return tested < axes ? bounds : target_of(all, bounds);
  };
  const std::uint32_t of_s = overlapping_along<Lanes, tested>(all.tiles[s], target(all.bounds[t]));
  if (of_s == 0) return;
  const std::uint32_t of_t = overlapping_along<Lanes, tested>(all.tiles[t], target(all.bounds[s]));
  const bool is_s_smaller = std::popcount(of_s) < std::popcount(of_t);
  const Node<axes>& smaller = all.tiles[is_s_smaller ? s : t];
  const Node<axes>& larger = all.tiles[is_s_smaller ? t : s];
  Pair* next = found.next();
  for (std::uint32_t bits = is_s_smaller ? of_s : of_t; bits != 0; bits &= bits - 1) {
    const auto k = lowest_bit(bits);
    const std::uint32_t found_in_larger = overlapping_along<Lanes, tested>(larger, target(smaller.get(k)));
    next = store_found(next, larger, found_in_larger, smaller.index[k], filters);
  }
  found.set_next(next);
}

/// Tests the boxes of two tiles, one of which overlaps the target of the other.
template <class Lanes, std::size_t axes>
BROADCL_INLINE void test(Found& found, const HostTiles<axes>& all, std::size_t s, std::size_t t,
                         std::span<const Filter> filters) {
  if constexpr (axes > 3) {
    // If each tile is at a single position along the fourth axis, the two positions were compared already.
    const auto is_flat = [](const Bounds<axes>& bounds) { return bounds.lower[3] == bounds.upper[3]; };
    if (is_flat(all.bounds[s]) && is_flat(all.bounds[t]))
      return test_along<Lanes, 3>(found, all, s, t, filters);
  }
  test_along<Lanes, axes>(found, all, s, t, filters);
}

/// Tests the boxes of a tile with each other.
template <class Lanes, std::size_t axes>
BROADCL_INLINE void test_itself(Found& found, const HostTiles<axes>& all, std::size_t s,
                                std::span<const Filter> filters) {
  if (!packed_overlaps<axes>(all.bounds[s], target_of(all, all.bounds[s]))) return;  // they are of one set
  const Node<axes>& tile = all.tiles[s];
  Pair* next = found.next();
  for (std::size_t k = 1; k < node_size; ++k) {
    const std::uint32_t bits = overlapping<Lanes>(tile, target_of(all, tile.get(k))) & (bit_of[k] - 1);
    next = store_found(next, tile, bits, tile.index[k], filters);
  }
  found.set_next(next);
}

/// Tests some tiles of a node with tiles of a node that is not earlier in the sweep.
/// @param tiles One bit per tile.
template <class Lanes, std::size_t axes>
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
      if (tiles_may_pair(s, s)) test_itself<Lanes>(found, all, s, filters);
      others &= 0xfffffffeU << child;
    }
    for (; others != 0; others &= others - 1) {
      const std::size_t t = other * node_size + lowest_bit(others);
      if (!tiles_may_pair(s, t)) continue;
      found.reserve(most);
      ++found.work;
      test<Lanes>(found, all, s, t, filters);
    }
  }
}

template <class Lanes, std::size_t axes>
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
    test_nodes<Lanes>(found, all, own, overlapping<Lanes>(all.nodes[own], target_of(all, others)) & tiles,
                      other, filters);
  }
}

/// Tests boxes of a tile that changed with all others, but with those that changed in earlier tiles.
template <class Lanes, std::size_t axes>
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
    const auto store = [&](const Node<axes>& others, std::uint32_t hits, std::uint32_t slot) {
      next = store_found(next, others, hits, slot, filters);
    };
    if (t == s) {
      for (std::uint32_t bits = of_own; bits != 0;
           bits &= bits - 1) {  // those not in `bits` have had their turn
        const std::size_t k = lowest_bit(bits);
        store(own, overlapping<Lanes>(own, target_of(all, own.get(k))) & ~bits, own.index[k]);
      }
    } else if ((of_own & (of_own - 1)) == 0) {
      store(tile, of_tile, own.index[lowest_bit(of_own)]);
    } else {
      const std::uint32_t hit = overlapping<Lanes>(own, target_of(all, all.bounds[t])) & of_own;
      const bool is_own_smaller = std::popcount(hit) < std::popcount(of_tile);
      const Node<axes>& smaller = is_own_smaller ? own : tile;
      const Node<axes>& larger = is_own_smaller ? tile : own;
      const std::uint32_t of_larger = is_own_smaller ? of_tile : hit;
      for (std::uint32_t bits = is_own_smaller ? hit : of_tile; bits != 0; bits &= bits - 1) {
        const std::size_t k = lowest_bit(bits);
        store(larger, overlapping<Lanes>(larger, target_of(all, smaller.get(k))) & of_larger,
              smaller.index[k]);
      }
    }
    found.set_next(next);
  };
  for (const Node<axes>& root : all.roots) {
    for (std::uint32_t nodes = overlapping<Lanes>(root, hull); nodes != 0; nodes &= nodes - 1) {
      const Node<axes>& node = all.nodes[root.index[lowest_bit(nodes)]];
      for (std::uint32_t tiles = overlapping<Lanes>(node, hull); tiles != 0; tiles &= tiles - 1)
        test_with(node.index[lowest_bit(tiles)]);
    }
  }
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

template <class Lanes, std::size_t axes>
BROADCL_INLINE void search_unsorted(std::vector<Pair>& pairs, HostTiles<axes>& all, const Input& input,
                                    std::span<const Filter> filters) {
  const auto slots = static_cast<std::uint32_t>(input.boxes.size());
  all.tiles.resize((slots + node_size - 1) / node_size);
  for (std::uint32_t slot = 0; slot < slots; ++slot)
    all.tiles[slot / node_size].set(slot % node_size, bounds_of<axes>(input, slot), slot);
  std::array<Pair, node_size * node_size> found;
  Pair* next = found.data();
  const auto append = [&] { pairs.insert(pairs.end(), found.data(), std::exchange(next, found.data())); };
  pairs.clear();
  const std::span<const Node<axes>> tiles = all.tiles;
  for (std::uint32_t slot = 1; slot < slots; ++slot) {
    const Node<axes>& own = tiles[slot / node_size];
    const Bounds<axes> target = target_of(all, own.get(slot % node_size));
    for (const Node<axes>& tile : tiles.first(slot / node_size)) {
      next = store_found(next, tile, overlapping<Lanes>(tile, target), slot, filters);
      if (next > &found[found.size() - 2 * node_size]) append();
    }
    const std::uint32_t before = bit_of[slot % node_size] - 1;
    next = store_found(next, own, overlapping<Lanes>(own, target) & before, slot, filters);
  }
  append();
}

#if defined(__x86_64__) && defined(__GNUC__)
template <std::size_t axes>
[[gnu::target("avx2")]] void search_tiles_avx2(Found& found, const HostTiles<axes>& all, std::size_t part,
                                               std::span<const Filter> filters) {
  search_tiles<EightLanes>(found, all, part, filters);
}
template <std::size_t axes>
[[gnu::target("avx2")]] void search_changed_avx2(Found& found, const HostTiles<axes>& all,
                                                 std::span<const std::uint32_t> changed, std::size_t tile,
                                                 std::span<const Filter> filters) {
  search_changed<EightLanes>(found, all, changed, tile, filters);
}
template <std::size_t axes>
[[gnu::target("avx2")]] std::size_t least_growth_avx2(std::span<const Node<axes>> nodes,
                                                      const Bounds<axes>& box) {
  return least_growth<EightLanes>(nodes, box);
}
template <std::size_t axes>
[[gnu::target("avx2")]] void search_unsorted_avx2(std::vector<Pair>& pairs, HostTiles<axes>& all,
                                                  const Input& input, std::span<const Filter> filters) {
  search_unsorted<EightLanes>(pairs, all, input, filters);
}
#endif

}  // namespace

template <std::size_t axes>
TileSearch<axes> tile_search(bool plain) {
#if defined(__x86_64__) && defined(__GNUC__)
  if (!plain && __builtin_cpu_supports("avx2") != 0)
    return {search_tiles_avx2<axes>, search_changed_avx2<axes>, least_growth_avx2<axes>,
            search_unsorted_avx2<axes>};
#else
  (void)plain;
#endif
  return {search_tiles<FourLanes, axes>, search_changed<FourLanes, axes>, least_growth<FourLanes, axes>,
          search_unsorted<FourLanes, axes>};
}
template TileSearch<3> tile_search<3>(bool);
template TileSearch<4> tile_search<4>(bool);

}  // namespace broadcl
