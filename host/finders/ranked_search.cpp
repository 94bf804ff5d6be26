#include "finders/ranked_search.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

#include "base/coordinate_map.hpp"
#include "base/distance.hpp"
#include "base/lanes.hpp"
#include "finders/slot_bounds.hpp"

namespace broadcl {
namespace {

using TwoFloats [[gnu::vector_size(8)]] = float;
using TwoDoubles [[gnu::vector_size(16)]] = double;
using FourDoubles [[gnu::vector_size(sizeof(EightLanes))]] = double;

/// As many floats as lanes.
template <class Lanes>
using FloatsFor =
    std::conditional_t<std::is_same_v<Lanes, TwoDoubles>, TwoFloats,
                       std::conditional_t<std::is_same_v<Lanes, FourDoubles>, FourLanes, Lanes>>;

template <class Bound>
using Column = std::array<Bound, node_size>;  // one for each child of a node

/// Bounds of children, by axis.
template <class Bound>
struct Columns {
  const Column<Bound>* lower;
  const Column<Bound>* upper;
};

// (Lanes are not returned, since that would be another calling convention for any processor.)
template <class Lanes, class Bound>
BROADCL_INLINE void load(Lanes& lanes, const Column<Bound>& column, std::size_t k) {
  std::memcpy(&lanes, &column[k], sizeof lanes);
}

/// squared_distance() of lanes.
/// @param are_near Receives which are at most so far away.
template <class Lanes, class Box, class Bits>
BROADCL_INLINE void find_distances(const Columns<BoundType<Box>>& boxes, std::size_t k, const Box& other,
                                   BoundType<Box> most, Lanes& squared, Bits& are_near) {
  squared = Lanes{};
#pragma GCC unroll 3
  for (std::size_t axis = 0; axis < 3; ++axis) {
    Lanes lower;
    Lanes upper;
    load(lower, boxes.lower[axis], k);
    load(upper, boxes.upper[axis], k);
    const Lanes above = lower - other.upper[axis];  // NaN, as the other one, if both are infinite
    const Lanes below = other.lower[axis] - upper;
    Lanes gap = above > below ? above : below;
    gap = gap >= least_distance<BoundType<Box>> ? gap : Lanes{};
    squared += gap * gap;
  }
  are_near = squared <= most;
}

/// How a moving box meets others along an axis.
template <class Bound>
struct Slab {
  template <class Box>
  Slab(const MovingBox<Box>& moving, std::size_t axis)
      : origin(moving.origin[axis]),
        reciprocal(moving.reciprocals[axis]),
        is_downward(reciprocal < 0),
        near(is_downward ? moving.box.lower[axis] : moving.box.upper[axis]),
        far(is_downward ? moving.box.upper[axis] : moving.box.lower[axis]) {}

  Bound origin;
  Bound reciprocal;
  bool is_downward;
  Bound near;  // what meets others first
  Bound far;
};

/// time_of_meeting() of lanes; what is met later than `most` may have any time after it.
/// @param are_met Receives which of them are met until then.
template <class Lanes, class Bound, class Bits>
BROADCL_INLINE void find_times(const Columns<Bound>& boxes, std::size_t k,
                               const std::array<Slab<Bound>, 3>& slabs, Bound most, Lanes& times,
                               Bits& are_met) {
  times = Lanes{};
  Lanes end = Lanes{} + most;
#pragma GCC unroll 3
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const Slab<Bound>& slab = slabs[axis];
    Lanes near;
    Lanes far;
    load(near, slab.is_downward ? boxes.upper[axis] : boxes.lower[axis], k);
    load(far, slab.is_downward ? boxes.lower[axis] : boxes.upper[axis], k);
    near = (near - slab.near) - slab.origin;
    far = (far - slab.far) - slab.origin;
    if (slab.reciprocal == 0) [[unlikely]] {
      end = ((near > 0) | (far < 0)) ? Lanes{} - 1 : end;
    } else {
      near *= slab.reciprocal;
      far *= slab.reciprocal;
      times = near > times ? near : times;
      end = far < end ? far : end;
    }
  }
  are_met = times <= end;
}

/// Combines all lanes into each of them.
template <class Vector, class Combine>
BROADCL_INLINE void fold(Vector& lanes, const Combine& combine) {
  constexpr std::size_t count = sizeof lanes / sizeof lanes[0];
  if constexpr (count == 8) {
    combine(lanes, __builtin_shufflevector(lanes, lanes, 4, 5, 6, 7, 0, 1, 2, 3));
    combine(lanes, __builtin_shufflevector(lanes, lanes, 2, 3, 0, 1, 6, 7, 4, 5));
    combine(lanes, __builtin_shufflevector(lanes, lanes, 1, 0, 3, 2, 5, 4, 7, 6));
  } else if constexpr (count == 4) {
    combine(lanes, __builtin_shufflevector(lanes, lanes, 2, 3, 0, 1));
    combine(lanes, __builtin_shufflevector(lanes, lanes, 1, 0, 3, 2));
  } else {
    combine(lanes, __builtin_shufflevector(lanes, lanes, 1, 0));
  }
}

/// A bit for each child of a node.
/// @param find Sets the bits of lanes.
template <class Lanes, class Bound, class Find>
BROADCL_INLINE std::uint32_t find_bits(const Find& find) {
  using Bits = decltype(Lanes{} <= Lanes{});
  using Slots = decltype(FloatsFor<Lanes>{} <= FloatsFor<Lanes>{});
  constexpr std::size_t lanes = sizeof(Lanes) / sizeof(Bound);
  Slots of_lanes;
  for (std::size_t lane = 0; lane < lanes; ++lane) of_lanes[lane] = std::int32_t{1} << lane;
  Slots all{};
#pragma GCC unroll 16
  for (std::size_t k = node_size; k > 0;) {
    k -= lanes;
    Bits bits;
    find(k, bits);
    all = all << int{lanes} | (of_lanes & __builtin_convertvector(bits, Slots));
  }
  fold(all, [](Slots& s, const Slots& t) BROADCL_INLINE_LAMBDA { s |= t; });
  return static_cast<std::uint32_t>(all[0]);
}

/// The boxes in which those lie that were converted to some.
struct Originals {
  std::array<Column<double>, 3> lower, upper;
  [[nodiscard]] Columns<double> get() const noexcept { return {lower.data(), upper.data()}; }
};
template <class Lanes>
BROADCL_INLINE void find_originals(const CoordinateMap& map, const Columns<float>& images,
                                   Originals& originals) {
  using Floats = FloatsFor<Lanes>;
  constexpr float largest = std::numeric_limits<float>::max();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const CoordinateMap::Shift back = map.shift_along(axis);
    const double most = back.limit > 0 ? back.limit * CoordinateMap::relative_error : -1;
    Column<double>& out_lower = originals.lower.at(axis);
    Column<double>& out_upper = originals.upper.at(axis);
    const std::uint32_t others =
        find_bits<Lanes, double>([&](std::size_t k, auto& are_others) BROADCL_INLINE_LAMBDA {
          Floats image;
          load(image, images.lower[axis], k);
          image = image > largest ? Floats{} + largest : image;  // since greater numbers become infinite
          const Lanes lower = __builtin_convertvector(image, Lanes);
          load(image, images.upper[axis], k);
          image = image < -largest ? Floats{} - largest : image;
          const Lanes upper = __builtin_convertvector(image, Lanes);
          const Lanes of_lower = (lower > -lower ? lower : -lower) * CoordinateMap::relative_error;
          const Lanes of_upper = (upper > -upper ? upper : -upper) * CoordinateMap::relative_error;
          are_others = (of_lower > most) | (of_upper > most);
          const Lanes least = lower - (of_lower + back.error) + back.shift;
          const Lanes greatest = upper + (of_upper + back.error) + back.shift;
          std::memcpy(&out_lower[k], &least, sizeof least);
          std::memcpy(&out_upper[k], &greatest, sizeof greatest);
        });
    for (std::uint32_t rest = others; rest != 0; rest &= rest - 1) {
      const auto k = static_cast<std::size_t>(std::countr_zero(rest));
      out_lower[k] = map.least_original(axis, images.lower[axis][k]);
      out_upper[k] = map.greatest_original(axis, images.upper[axis][k]);
    }
  }
}

/// Finds the keys of the children of a node; infinite for those that are not wanted.
/// @param bounds Of the children, without their reaches if they are boxes.
/// @param place Along the fourth axis, of the search.
/// @param find_key Sets the keys of lanes, and which of them are wanted.
/// @returns A bit for each that is wanted.
template <class Lanes, class Bound, std::size_t axes, class FindKey>
BROADCL_INLINE std::uint32_t find_keys(const Node<axes>& node, const Bounds<axes>& place, Column<Bound>& keys,
                                       const FindKey& find_key) {
  using Floats = FloatsFor<Lanes>;
  return find_bits<Lanes, Bound>([&](std::size_t k, auto& wanted) BROADCL_INLINE_LAMBDA {
    Lanes key;
    find_key(k, key, wanted);
    Floats lower;
    Floats upper;
    load(lower, node.lower[0], k);
    load(upper, node.upper[0], k);
    auto is_there = lower <= upper;
    if constexpr (axes > 3) {
      load(lower, node.lower[3], k);
      load(upper, node.upper[3], k);
      is_there &= (lower <= place.upper[3]) & (place.lower[3] <= upper);
    }
    wanted &= __builtin_convertvector(is_there, std::remove_reference_t<decltype(wanted)>);
    key = wanted ? key : Lanes{} + std::numeric_limits<Bound>::infinity();
    std::memcpy(&keys[k], &key, sizeof key);
  });
}

/// Calls function(child) for those that are wanted when it is their turn: if the search is limited, in the
/// order of their keys, and of the slots if these are equal.
/// @param keys Infinite for others.
template <class Lanes, class Box, std::size_t axes, class Function>
BROADCL_INLINE void for_each_wanted(const RankedSearch<Box>& search, const Node<axes>& node,
                                    std::uint32_t children, const Column<BoundType<Box>>& keys,
                                    const Function& function) {
  using Bound = BoundType<Box>;
  constexpr std::size_t lanes = sizeof(Lanes) / sizeof(Bound);
  std::array<Lanes, node_size / lanes> left;
  std::memcpy(left.data(), keys.data(), sizeof left);
  // (The function is inlined, so it is called in one place only.)
  while (children != 0) {
    std::uint32_t next = children;
    Bound key{};
    if (search.is_limited) {
      Lanes least = left[0];
#pragma GCC unroll 16
      for (std::size_t k = 1; k < left.size(); ++k) least = left[k] < least ? left[k] : least;
      fold(least, [](Lanes& s, const Lanes& t) BROADCL_INLINE_LAMBDA { s = t < s ? t : s; });
      key = least[0];
      next &= find_bits<Lanes, Bound>([&](std::size_t k, auto& bits) BROADCL_INLINE_LAMBDA {
        Lanes& some = left[k / lanes];
        bits = some == key;
        some = some > key ? some : Lanes{} + std::numeric_limits<Bound>::infinity();
      });
    }
    children ^= next;
    while (next != 0) {
      auto first = static_cast<std::size_t>(std::countr_zero(next));
      if (search.is_limited) {
        for (std::uint32_t rest = next & (next - 1); rest != 0; rest &= rest - 1) {
          const auto k = static_cast<std::size_t>(std::countr_zero(rest));
          if (node.index[k] < node.index[first]) first = k;
        }
        if (!search.wants(key, node.index[first])) return;
      }
      next ^= 1U << first;
      function(first);
    }
  }
}

/// @param find_key Sets the keys of lanes of columns, and which of them have one.
template <class Lanes, class Box, std::size_t axes, class FindKey>
BROADCL_INLINE void search_by(RankedSearch<Box>& search, const HostTiles<axes>& all,
                              const FindKey& find_key) {
  using Bound = BoundType<Box>;
  using Bits = decltype(Lanes{} <= Lanes{});
  const Bounds<axes> place = bounds_of<axes>(QueryBox{.box = {}, .world = search.world}, all.sets);
  const auto find = [&](const Node<axes>& node, const Columns<float>& bounds,
                        Column<Bound>& keys) BROADCL_INLINE_LAMBDA {
    const auto find_in = [&](const Columns<Bound>& columns) BROADCL_INLINE_LAMBDA {
      return find_keys<Lanes>(node, place, keys,
                              [&](std::size_t k, Lanes& key, Bits& wanted)
                                  BROADCL_INLINE_LAMBDA { find_key(columns, k, key, wanted); });
    };
    if constexpr (std::is_same_v<Bound, double>) {
      Originals originals;
      find_originals<Lanes>(*search.map, bounds, originals);
      return find_in(originals.get());
    } else {
      return find_in(bounds);
    }
  };
  const auto columns_of = [](const auto& boxes) -> Columns<float> {
    return {boxes.lower.data(), boxes.upper.data()};
  };
  const auto for_children = [&](const Node<axes>& node, const auto& function) BROADCL_INLINE_LAMBDA {
    Column<Bound> keys;
    const std::uint32_t children = find(node, columns_of(node), keys);
    for_each_wanted<Lanes>(search, node, children, keys, function);
  };
  const auto search_tile = [&](std::size_t t) BROADCL_INLINE_LAMBDA {
    Column<Bound> keys;
    const Node<axes>& tile = all.tiles[t];
    const std::uint32_t boxes = find(tile, all.reaches ? columns_of(all.boxes[t]) : columns_of(tile), keys);
    for_each_wanted<Lanes>(search, tile, boxes, keys,
                           [&](std::size_t k) { search.take(tile.index[k], keys[k]); });
  };
  for (std::size_t t = 0; t < all.tops.size(); ++t) {
    Column<Bound> keys{};
    const std::uint32_t roots = all.roots.size() > 1 ? find(all.tops[t], columns_of(all.tops[t]), keys) : 1;
    for_each_wanted<Lanes>(search, all.tops[t], roots, keys, [&](std::size_t i) BROADCL_INLINE_LAMBDA {
      const std::size_t r = t * node_size + i;
      for_children(all.roots[r], [&](std::size_t j) BROADCL_INLINE_LAMBDA {
        const std::size_t n = r * node_size + j;
        for_children(all.nodes[n],
                     [&](std::size_t k) BROADCL_INLINE_LAMBDA { search_tile(n * node_size + k); });
      });
    });
  }
}

template <class Lanes, class Box, std::size_t axes>
BROADCL_INLINE void search_ranked(RankedSearch<Box>& search, const HostTiles<axes>& all) {
  using Bound = BoundType<Box>;
  using Bits = decltype(Lanes{} <= Lanes{});
  if (search.moving == nullptr) {
    search_by<Lanes>(
        search, all,
        [&](const Columns<Bound>& boxes, std::size_t k, Lanes& key, Bits& wanted)
            BROADCL_INLINE_LAMBDA { find_distances(boxes, k, search.box, search.most, key, wanted); });
  } else {
    const std::array<Slab<Bound>, 3> slabs{{{*search.moving, 0}, {*search.moving, 1}, {*search.moving, 2}}};
    search_by<Lanes>(search, all,
                     [&](const Columns<Bound>& boxes, std::size_t k, Lanes& key, Bits& wanted)
                         BROADCL_INLINE_LAMBDA { find_times(boxes, k, slabs, search.most, key, wanted); });
  }
}

template <class Box, class Floats, class Doubles>
using LanesFor = std::conditional_t<std::is_same_v<Box, Aabb>, Floats, Doubles>;

#if defined(__x86_64__) && defined(__GNUC__)
template <std::size_t axes, class Box>
[[gnu::target("avx2")]] void search_ranked_avx2(RankedSearch<Box>& search, const HostTiles<axes>& all) {
  search_ranked<LanesFor<Box, EightLanes, FourDoubles>>(search, all);
}
#endif

}  // namespace

template <std::size_t axes, class Box>
RankedTileSearch<axes, Box> ranked_tile_search(bool plain) {
#if defined(__x86_64__) && defined(__GNUC__)
  if (!plain && __builtin_cpu_supports("avx2") != 0) return search_ranked_avx2<axes, Box>;
#else
  (void)plain;
#endif
  return search_ranked<LanesFor<Box, FourLanes, TwoDoubles>, Box, axes>;
}
template RankedTileSearch<3, Aabb> ranked_tile_search(bool);
template RankedTileSearch<4, Aabb> ranked_tile_search(bool);
template RankedTileSearch<3, Aabb64> ranked_tile_search(bool);
template RankedTileSearch<4, Aabb64> ranked_tile_search(bool);

}  // namespace broadcl
