#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>

#include "base/parallel.hpp"

namespace broadcl {

class HitList;
struct Input;

/// Boxes per tile, and tiles per node: as many as a word has bits.
inline constexpr std::size_t node_size = 32;
inline constexpr std::uint32_t no_slot = 0xffffffff;

/// Lower and upper bounds along each axis. If objects are in different worlds, these are a fourth axis.
// (Pragmas unroll loops over the axes, because GCC alone does so with -O3 only.)
template <std::size_t axes>
struct Bounds {
  std::array<float, axes> lower, upper;
};

template <std::size_t axes>
Bounds<axes> make_bounds(float lower, float upper) {
  Bounds<axes> bounds;
  bounds.lower.fill(lower);
  bounds.upper.fill(upper);
  return bounds;
}

template <std::size_t axes>
void extend(Bounds<axes>& bounds, const Bounds<axes>& by) {
#pragma GCC unroll 4
  for (std::size_t axis = 0; axis < axes; ++axis) {  // NaN changes nothing
    bounds.lower[axis] = by.lower[axis] < bounds.lower[axis] ? by.lower[axis] : bounds.lower[axis];
    bounds.upper[axis] = by.upper[axis] > bounds.upper[axis] ? by.upper[axis] : bounds.upper[axis];
  }
}

/// Along an axis; finite.
template <std::size_t axes>
float centre_of(const Bounds<axes>& bounds, std::size_t axis) {
  constexpr float most = std::numeric_limits<float>::max();
  return std::max(bounds.lower[axis], -most) / 2 + std::min(bounds.upper[axis], most) / 2;
}

/// The bounds of boxes or of tiles, by component, so that one instruction compares several of them. Unused
/// entries are NaN.
template <std::size_t axes>
struct alignas(cache_line) Node {
  std::array<std::array<float, node_size>, axes> lower, upper;
  std::array<std::uint32_t, node_size> index;  // slots; of tiles, not greater than any slot in them

  void set(std::size_t k, const Bounds<axes>& bounds, std::uint32_t index_of_k) {
#pragma GCC unroll 4
    for (std::size_t axis = 0; axis < axes; ++axis) {
      lower[axis][k] = bounds.lower[axis];
      upper[axis][k] = bounds.upper[axis];
    }
    index[k] = index_of_k;
  }
  [[nodiscard]] Bounds<axes> get(std::size_t k) const {
    Bounds<axes> bounds;
#pragma GCC unroll 4
    for (std::size_t axis = 0; axis < axes; ++axis) {
      bounds.lower[axis] = lower[axis][k];
      bounds.upper[axis] = upper[axis][k];
    }
    return bounds;
  }
};

/// The boxes of a tile and their reaches, by component, if its bounds are those of grown boxes. Unused
/// entries are unspecified.
struct alignas(cache_line) TileBoxes {
  std::array<std::array<float, node_size>, 3> lower, upper;
  std::array<float, node_size> reach;

  void set(std::size_t k, const Aabb& box, float reach_of_k) {
#pragma GCC unroll 3
    for (std::size_t axis = 0; axis < 3; ++axis) {
      lower[axis][k] = box.lower[axis];
      upper[axis][k] = box.upper[axis];
    }
    reach[k] = reach_of_k;
  }
  [[nodiscard]] Aabb get(std::size_t k) const {
    return {{lower[0][k], lower[1][k], lower[2][k]}, {upper[0][k], upper[1][k], upper[2][k]}};
  }
};

/// Neighbouring boxes in tiles, neighbouring tiles in nodes, these in roots, and these in tops.
template <std::size_t axes>
struct HostTiles {
  std::vector<Node<axes>> tiles;
  std::vector<TileBoxes> boxes;      // in the tiles; none if there are no reaches
  std::vector<Bounds<axes>> bounds;  // of the tiles
  std::vector<Node<axes>> nodes;
  std::vector<Node<axes>> roots;
  std::vector<Node<axes>> tops;
  std::vector<Filter> tile_filters;  // by filter_of(), until boxes change; none if they do not matter
  std::vector<Filter> node_filters;
  std::vector<std::uint32_t> sweep;  // nodes by ascending lower bounds along the axis, until boxes change
  std::size_t axis = 0;
  /// Whether there are two sets: along the fourth axis, set s of world w is at 2 w + s, and only pairs of one
  /// object of each set are reported.
  bool sets = false;
  bool reaches = false;  // whether boxes have to be within the sum of their reaches
};

/// Queries, or a single one. Unused entries of `bounds` are NaN, unless it is one.
template <std::size_t axes>
struct QueryTile {
  Node<axes> bounds;  // of grown boxes
  TileBoxes boxes;
  Bounds<axes> hull = make_bounds<axes>(infinity, -infinity);
  std::uint32_t size = 0;
  bool any_reach = false;

  void add(const Aabb& box, float reach, const Bounds<axes>& grown) {
    if (size == 1) {
      for (std::size_t k = 1; k < node_size; ++k)
        bounds.set(k, make_bounds<axes>(std::numeric_limits<float>::quiet_NaN(), 0), no_slot);
    }
    bounds.set(size, grown, size);
    boxes.set(size, box, reach);
    extend(hull, grown);
    any_reach = any_reach || reach > 0;
    ++size;
  }

 private:
  static constexpr float infinity = std::numeric_limits<float>::infinity();
};

/// A filter that pairs with nothing.
inline constexpr Filter no_filter{.group = 0, .mask = 0};

/// Makes a filter pair with what another one pairs with, too, whatever the bodies and worlds.
inline void extend(Filter& filter, const Filter& by) {
  filter.group |= by.group;
  filter.mask |= by.mask;
}

/// A filter that pairs with what some box of a tile pairs with.
template <std::size_t axes>
Filter filter_of(const Node<axes>& tile, std::span<const Filter> filters) {
  Filter filter = no_filter;
  for (std::size_t k = 0; k < node_size; ++k) {
    if (tile.lower[0][k] <= tile.upper[0][k]) extend(filter, filters[tile.index[k]]);
  }
  return filter;
}

/// How many pairs all threads found in a search, and how many of them are stored at most. Beyond that, pairs
/// are counted only.
struct PairCount {
  std::atomic<std::size_t> count = 0;
  std::size_t most_stored = 0;
};

/// The pairs that a thread found, in blocks, so that none is copied when there are more, and no memory is
/// written in advance. The blocks are kept.
class alignas(cache_line) Found {
 public:
  std::size_t work = 0;

  /// @param count Must outlive the search.
  void clear(PairCount& count) noexcept {
    work = used_ = 0;
    next_ = end_ = nullptr;
    count_ = &count;
  }
  /// Must be called when all pairs have been stored.
  void end() noexcept {
    if (used_ > 0) count_->count += in_last_block();
  }
  /// Must be called before some pairs are stored: at most those of two tiles.
  /// @throws std::bad_alloc
  void reserve(std::size_t more) {
    if (static_cast<std::size_t>(end_ - next_) < more) start_block();
  }
  /// Where the next pair is to be stored, and, after some have been, where the one after them is.
  [[nodiscard]] Pair* next() const noexcept { return next_; }
  void set_next(Pair* next) noexcept { next_ = next; }
  /// Appends one list per block.
  void get(std::vector<std::span<const Pair>>& lists) const {
    for (std::size_t k = 0; k < used_; ++k) {
      const Pair* const begin = blocks_[k].pairs.get();
      lists.emplace_back(begin, k + 1 < used_ ? blocks_[k].end : next_);
    }
  }

 private:
  /// The first block is small, for small scenes; each is twice as large as the one before, up to a limit.
  [[nodiscard]] static std::size_t block_size(std::size_t block) noexcept {
    return 2 * node_size * node_size << std::min<std::size_t>(block, 5);
  }
  using Pairs = std::unique_ptr<Pair[]>;  // NOLINT(modernize-avoid-c-arrays)
  struct Block {
    Pairs pairs;
    const Pair* end = nullptr;  // of those that were found, unless it is the last block
  };

  [[nodiscard]] std::size_t in_last_block() const noexcept {
    return static_cast<std::size_t>(next_ - blocks_[used_ - 1].pairs.get());
  }

  [[gnu::noinline]] void start_block() {
    if (used_ > 0 && (count_->count += in_last_block()) > count_->most_stored) {
      next_ = blocks_[used_ - 1].pairs.get();
      return;
    }
    const std::size_t size = block_size(used_);
    if (used_ == blocks_.size()) blocks_.push_back({.pairs = Pairs(new Pair[size])});
    if (used_ > 0) blocks_[used_ - 1].end = next_;
    next_ = blocks_[used_++].pairs.get();
    end_ = next_ + size;
  }

  PairCount* count_ = nullptr;
  std::vector<Block> blocks_;
  std::size_t used_ = 0;
  Pair* next_ = nullptr;
  Pair* end_ = nullptr;
};

/// So that threads can share the tiles of a node.
inline constexpr std::size_t parts_per_node = 4;

/// The searches, compiled for a type of processor.
template <std::size_t axes>
struct TileSearch {
  /// Finds the pairs of some tiles with themselves and with tiles of nodes that are not earlier in the sweep.
  /// @param part Less than parts_per_node times the number of nodes.
  void (*tiles)(Found& found, const HostTiles<axes>& all, std::size_t part, std::span<const Filter> filters);
  /// Finds the pairs of the boxes of a tile that changed with all others, except those that changed in
  /// earlier tiles.
  /// @param changed By tile, a bit for each box.
  /// @param tile One of those that have such a box.
  void (*changed)(Found& found, const HostTiles<axes>& all, std::span<const std::uint32_t> changed,
                  std::size_t tile, std::span<const Filter> filters);
  /// Appends all boxes that some queries overlap or, if there are reaches, that are within them.
  /// @throws std::bad_alloc
  void (*queries)(HitList& hits, const HostTiles<axes>& all, const QueryTile<axes>& queries);
  /// @returns Which child of some nodes, all of them counted, grows least if it is to contain a box; one of
  /// the same world if there is one.
  std::size_t (*least_growth)(std::span<const Node<axes>> nodes, const Bounds<axes>& box);
  /// Finds all pairs, in canonical order, by testing each box with all before it. Of `all`, it reads `sets`
  /// and writes the tiles and their boxes.
  /// @throws std::bad_alloc
  void (*unsorted)(std::vector<Pair>& pairs, HostTiles<axes>& all, const Input& input,
                   std::span<const Filter> filters);
};

/// @param reaches HostTiles::reaches
/// @param plain Whether to return the version for any processor, instead of the one for this processor.
template <std::size_t axes>
[[nodiscard]] TileSearch<axes> tile_search(bool reaches, bool plain = false);

}  // namespace broadcl
