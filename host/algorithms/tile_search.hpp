#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>

namespace broadcl {

/// Boxes per tile, and tiles per node: as many as a word has bits.
inline constexpr std::size_t node_size = 32;
inline constexpr std::uint32_t no_slot = 0xffffffff;

/// Lower and upper bounds along each axis. If objects are in different worlds, these are a fourth axis.
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
  for (std::size_t axis = 0; axis < axes; ++axis) {  // NaN changes nothing
    bounds.lower[axis] = by.lower[axis] < bounds.lower[axis] ? by.lower[axis] : bounds.lower[axis];
    bounds.upper[axis] = by.upper[axis] > bounds.upper[axis] ? by.upper[axis] : bounds.upper[axis];
  }
}

/// The bounds of boxes or of tiles, by component, so that one instruction compares several of them. Unused
/// entries are NaN.
template <std::size_t axes>
struct alignas(64) Node {
  std::array<std::array<float, node_size>, axes> lower, upper;
  std::array<std::uint32_t, node_size> index;  // slots or tiles

  void set(std::size_t k, const Bounds<axes>& bounds, std::uint32_t index_of_k) {
    for (std::size_t axis = 0; axis < axes; ++axis) {
      lower[axis][k] = bounds.lower[axis];
      upper[axis][k] = bounds.upper[axis];
    }
    index[k] = index_of_k;
  }
  [[nodiscard]] Bounds<axes> get(std::size_t k) const {
    Bounds<axes> bounds;
    for (std::size_t axis = 0; axis < axes; ++axis) {
      bounds.lower[axis] = lower[axis][k];
      bounds.upper[axis] = upper[axis][k];
    }
    return bounds;
  }
};

/// Neighbouring boxes in tiles, neighbouring tiles in nodes, and these in roots.
template <std::size_t axes>
struct HostTiles {
  std::vector<Node<axes>> tiles;
  std::vector<Bounds<axes>> bounds;  // of the tiles
  std::vector<Node<axes>> nodes;
  std::vector<Node<axes>> roots;
  std::vector<std::uint32_t> sweep;  // nodes by ascending lower bounds along the axis, until boxes change
  std::size_t axis = 0;
  /// Whether there are two sets: along the fourth axis, set s of world w is at 2 w + s, and only pairs of one
  /// object of each set are sought.
  bool sets = false;
};

/// The pairs that a thread found.
struct Found {
  std::vector<Pair> pairs;  // of which the first `count` were found
  std::size_t count = 0;
  std::size_t work = 0;

  void reserve(std::size_t more) {
    if (pairs.size() < count + more) pairs.resize(2 * pairs.size() + more);
  }
};

/// So that threads can share the tiles of a node.
inline constexpr std::size_t parts_per_node = 4;

/// The searches, compiled for a type of processor.
template <std::size_t axes>
struct TileSearch {
  /// Finds the pairs of some tiles with themselves and with tiles of nodes that are not earlier in the sweep.
  /// @param part Less than parts_per_node times the number of nodes.
  void (*tiles)(Found& found, const HostTiles<axes>& all, std::size_t part, std::span<const Filter> filters);
  /// Finds the pairs of some boxes, given by their places in the tiles, with all others.
  void (*boxes)(Found& found, const HostTiles<axes>& all, std::span<const std::uint32_t> places,
                std::span<const Filter> filters);
};

/// @param plain Whether to return the version for any processor, instead of the one for this processor.
template <std::size_t axes>
[[nodiscard]] TileSearch<axes> tile_search(bool plain = false);

}  // namespace broadcl
