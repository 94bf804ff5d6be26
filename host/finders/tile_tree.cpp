#include "finders/tile_tree.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "base/floating_point.hpp"
#include "base/parallel.hpp"
#include "base/prefetch.hpp"
#include "finders/slot_bounds.hpp"

namespace broadcl {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float not_a_number = std::numeric_limits<float>::quiet_NaN();

/// Of no box.
template <std::size_t axes>
Bounds<axes> nowhere() {
  return make_bounds<axes>(infinity, -infinity);
}

/// What has no child.
template <std::size_t axes>
Node<axes> empty_node() {
  Node<axes> node;
  for (std::size_t k = 0; k < node_size; ++k)
    node.set(k, make_bounds<axes>(not_a_number, not_a_number), no_slot);
  return node;
}

bool has_box(const Input& input, std::uint32_t slot) {
  return slot < input.boxes.size() && !std::isnan(input.boxes[slot].lower[0]);
}

/// The bounds of all children of a node.
template <std::size_t axes>
Bounds<axes> bounds_of(const Node<axes>& node) {
  Bounds<axes> bounds = nowhere<axes>();
  for (std::size_t k = 0; k < node_size; ++k) extend(bounds, node.get(k));
  return bounds;
}

template <std::size_t axes>
std::uint32_t least_index(const Node<axes>& node) {
  return std::ranges::min(node.index);
}

/// Twice as large, about the same centre.
template <std::size_t axes>
Bounds<axes> home_of(Bounds<axes> bounds) {
#pragma GCC unroll 4
  for (std::size_t axis = 0; axis < axes; ++axis) {
    const float half = (bounds.upper[axis] - bounds.lower[axis]) / 2;
    const float margin = half > 0 ? half : 0;  // NaN if the boxes are at infinity
    bounds.lower[axis] -= margin;
    bounds.upper[axis] += margin;
  }
  return bounds;
}

template <std::size_t axes>
bool is_within(const Bounds<axes>& bounds, const Bounds<axes>& home) {
  bool within = true;
#pragma GCC unroll 4
  for (std::size_t axis = 0; axis < axes; ++axis)
    within &= home.lower[axis] <= bounds.lower[axis] && bounds.upper[axis] <= home.upper[axis];
  return within;
}

/// The half of the children of a full node that are farther along the axis along which their centres extend
/// farthest, a bit for each.
template <std::size_t axes>
std::uint32_t upper_half(const Node<axes>& node) {
  std::array<std::pair<float, std::uint32_t>, node_size> best;
  float widest = -1;
  for (std::size_t axis = axes; axis-- > 0;) {
    std::array<std::pair<float, std::uint32_t>, node_size> centres;
    for (std::uint32_t k = 0; k < node_size; ++k) centres[k] = {centre_of(node.get(k), axis), k};
    const auto [least, greatest] = std::ranges::minmax_element(centres);
    const float width = greatest->first - least->first;
    if (width <= widest) continue;
    widest = width;
    best = centres;
    if (axis == 3 && width > 0) break;  // worlds before places
  }
  std::ranges::nth_element(best, best.begin() + node_size / 2);
  std::uint32_t half = 0;
  for (std::size_t k = node_size / 2; k < node_size; ++k) half |= 1U << best[k].second;
  return half;
}

template <class Function>
void for_each_bit(std::uint32_t bits, const Function& function) {
  for (; bits != 0; bits &= bits - 1) function(static_cast<std::size_t>(std::countr_zero(bits)));
}

}  // namespace

template <std::size_t axes>
void TileTree<axes>::start(TileOrder& order, const Input& input) {
  const std::size_t tiles = std::max<std::size_t>(1, (order.slots.size() + node_size - 1) / node_size);
  order.slots.resize(tiles * node_size, no_slot);
  order_.swap(order.slots);
  places_.swap(order.places);
  size_ = order_.size() - static_cast<std::size_t>(std::ranges::count(order_, no_slot));
  left_.clear();
  all_.nodes.clear();
  all_.roots.clear();
  all_.tops.clear();
  resize(tiles);
  std::ranges::fill(unread_, ~0U);
  read_nodes_ = 0;
  find_left(input);
}

/// Takes the boxes of a tile from the order.
template <std::size_t axes>
void TileTree<axes>::start_tile(std::size_t tile) {
  Occupancy& occupancy = occupancy_[tile];
  occupancy = {.home = make_bounds<axes>(-infinity, infinity), .taken = 0, .unread = ~0U, .leaving = 0};
  for (std::size_t k = 0; k < node_size; ++k) {
    const std::uint32_t slot = order_[tile * node_size + k];
    if (slot == no_slot) {
      all_.tiles[tile].set(k, make_bounds<axes>(not_a_number, not_a_number), no_slot);
    } else {
      all_.tiles[tile].index[k] = slot;
      occupancy.taken |= 1U << k;
    }
  }
}

template <std::size_t axes>
bool TileTree<axes>::is_abandoned(const Input& input) const {
  constexpr std::size_t samples = 64;
  std::size_t left = 0;
  for (std::size_t slot = 0; slot < places_.size(); slot += places_.size() / samples + 1) {
    const std::uint32_t place = places_[slot];
    left += static_cast<std::size_t>(
        place != no_slot && slot < input.boxes.size() &&
        !is_within(broadcl::bounds_of<axes>(input, slot), occupancy_[place / node_size].home));
  }
  return left > samples / 6;
}

template <std::size_t axes>
bool TileTree<axes>::read(const Input& input, std::size_t most, const Threads& threads) {
  if (places_.size() < input.boxes.size()) places_.resize(input.boxes.size(), no_slot);
  nodes_.clear();
  const std::size_t first_new = read_nodes_;
  if (input.changed.all) {
    std::ranges::fill(unread_, ~0U);
    nodes_.resize(first_new);
    std::iota(nodes_.begin(), nodes_.end(), 0U);
  } else {
    for (const std::uint32_t slot : input.changed.slots) {
      const std::uint32_t place = place_of(slot);
      if (place == no_slot) {
        left_.push_back(slot);
        continue;
      }
      const std::uint32_t tile = place / node_size;
      const std::uint32_t node = tile / node_size;
      if (unread_[node] == 0) nodes_.push_back(node);  // those that were never read are not 0
      unread_[node] |= 1U << tile % node_size;
      occupancy_[tile].unread |= 1U << place % node_size;
    }
  }
  for (; read_nodes_ < unread_.size() && read_nodes_ - first_new < most; ++read_nodes_)
    nodes_.push_back(static_cast<std::uint32_t>(read_nodes_));
  parallel_for(nodes_.size(), threads, [&](std::size_t k, std::size_t /*thread*/) {
    const DefaultFloatingPoint as_everywhere;
    const std::size_t node = nodes_[k];
    for_each_unread(node, [&](std::size_t tile) {
      if (node >= first_new) start_tile(tile);
      read_tile(input, tile);
    });
    update_node(node, unread_[node]);
  });
  std::size_t root = no_slot;
  for (const std::uint32_t node : nodes_) {
    if (node / node_size != root) update_root(root = node / node_size);
    for_each_unread(node, [&](std::size_t tile) {
      for_each_bit(occupancy_[tile].leaving, [&](std::size_t k) { take_out(all_.tiles[tile].index[k]); });
    });
    unread_[node] = 0;
  }
  if (input.changed.all) find_left(input);
  return read_nodes_ == unread_.size();
}

template <std::size_t axes>
template <class Function>
void TileTree<axes>::for_each_unread(std::size_t node, const Function& function) {
  for_each_bit(unread_[node], [&](std::size_t k) {
    if (node * node_size + k < all_.tiles.size()) function(node * node_size + k);
  });
}

/// Puts the box of a slot into a place of a tile.
template <std::size_t axes>
void TileTree<axes>::set_place(const Input& input, std::size_t place, const Bounds<axes>& box,
                               std::uint32_t slot) {
  const std::size_t tile = place / node_size;
  all_.tiles[tile].set(place % node_size, box, slot);
  if (all_.reaches) all_.boxes[tile].set(place % node_size, input.boxes[slot], input.rules.reaches[slot]);
}

template <std::size_t axes>
[[gnu::noinline]] void TileTree<axes>::read_tile(const Input& input, std::size_t tile) {
  Node<axes>& node = all_.tiles[tile];
  Occupancy& occupancy = occupancy_[tile];
  Bounds<axes>& bounds = all_.bounds[tile] = nowhere<axes>();
  occupancy.leaving = 0;
  const std::uint32_t unread = std::exchange(occupancy.unread, 0) | (input.changed.all ? ~0U : 0U);
  const std::uint32_t read = unread & occupancy.taken;
  if (all_.reaches) {
    for_each_bit(read, [&](std::size_t k) {
      prefetch(input.boxes.data() + node.index[k]);
      prefetch(input.rules.reaches.data() + node.index[k]);
    });
  }
  for_each_bit(read, [&](std::size_t k) {
    const std::uint32_t slot = node.index[k];
    Bounds<axes> box = make_bounds<axes>(not_a_number, not_a_number);
    if (has_box(input, slot)) box = broadcl::bounds_of<axes>(input, slot);
    if (!is_within(box, occupancy.home)) {
      occupancy.leaving |= 1U << k;
      box = make_bounds<axes>(not_a_number, not_a_number);
    } else if (all_.reaches) {
      all_.boxes[tile].set(k, input.boxes[slot], input.rules.reaches[slot]);
    }
    node.set(k, box, slot);
    extend(bounds, box);
  });
  if (~unread != 0) bounds = bounds_of(node);
  if (input.changed.all || occupancy.home.lower[0] == -infinity) occupancy.home = home_of(bounds);
}

template <std::size_t axes>
void TileTree<axes>::take_out(std::uint32_t slot) {
  const std::uint32_t place = place_of(slot);
  if (place == no_slot) return;
  if (place / node_size / node_size < read_nodes_) {
    clear_place(place);
  } else {
    order_[place] = places_[slot] = no_slot;
  }
  --size_;
  left_.push_back(slot);
}

template <std::size_t axes>
void TileTree<axes>::insert(const Input& input) {
  const DefaultFloatingPoint as_everywhere;
  for (const std::uint32_t slot : left_) {
    if (has_box(input, slot) && places_[slot] == no_slot) insert(input, slot);
  }
  left_.clear();
}

/// Lists the slots whose boxes have no place.
template <std::size_t axes>
void TileTree<axes>::find_left(const Input& input) {
  if (size_ == input.boxes.size()) return;
  left_.clear();
  places_.resize(std::max(places_.size(), input.boxes.size()), no_slot);
  for (std::uint32_t slot = 0; slot < input.boxes.size(); ++slot) {
    if (places_[slot] == no_slot && has_box(input, slot)) left_.push_back(slot);
  }
}

/// Adds empty tiles, and nodes for them; or takes the last tiles away.
template <std::size_t axes>
void TileTree<axes>::resize(std::size_t tiles) {
  const auto resize = [](auto& list, std::size_t size, const auto& value) {
    if (size > list.capacity()) list.reserve(size + size / 2);
    list.resize(size, value);
  };
  const auto parents_of = [](std::size_t children) { return (children + node_size - 1) / node_size; };
  resize(all_.tiles, tiles, empty_node<axes>());
  if (all_.reaches) resize(all_.boxes, tiles, TileBoxes());
  resize(all_.bounds, tiles, nowhere<axes>());
  resize(occupancy_, tiles, Occupancy{.home = nowhere<axes>(), .taken = 0, .unread = 0, .leaving = 0});
  resize(all_.nodes, parents_of(tiles), empty_node<axes>());
  resize(all_.roots, parents_of(all_.nodes.size()), empty_node<axes>());
  resize(all_.tops, parents_of(all_.roots.size()), empty_node<axes>());
  resize(unread_, all_.nodes.size(), 0U);
}

template <std::size_t axes>
void TileTree<axes>::clear_place(std::size_t place) {
  const std::size_t tile = place / node_size;
  const std::size_t k = place % node_size;
  const std::uint32_t slot = all_.tiles[tile].index[k];
  if (slot != no_slot) places_[slot] = no_slot;
  all_.tiles[tile].set(k, make_bounds<axes>(not_a_number, not_a_number), no_slot);
  occupancy_[tile].taken &= ~(1U << k);
}

/// Sets the bounds of the children of a node that changed, and its own.
template <std::size_t axes>
void TileTree<axes>::update_node(std::size_t node, std::uint32_t children) {
  for_each_bit(children, [&](std::size_t k) {
    const std::size_t tile = node * node_size + k;
    if (tile < all_.tiles.size()) all_.nodes[node].set(k, all_.bounds[tile], least_index(all_.tiles[tile]));
  });
  all_.roots[node / node_size].set(node % node_size, bounds_of(all_.nodes[node]),
                                   least_index(all_.nodes[node]));
}

/// Sets the bounds of a root whose children changed.
template <std::size_t axes>
void TileTree<axes>::update_root(std::size_t root) {
  all_.tops[root / node_size].set(root % node_size, bounds_of(all_.roots[root]),
                                  least_index(all_.roots[root]));
}

template <std::size_t axes>
[[gnu::noinline]] void TileTree<axes>::insert(const Input& input, std::uint32_t slot) {
  const Bounds<axes> box = broadcl::bounds_of<axes>(input, slot);
  const auto least_growth = tile_search<axes>(all_.reaches).least_growth;
  const std::size_t node = least_growth(all_.roots, box);
  const std::size_t tile = node * node_size + least_growth(std::span(all_.nodes).subspan(node, 1), box);
  if (~occupancy_[tile].taken == 0) {
    const std::size_t other = empty_tile(node);
    other == no_slot ? divide_node(node) : divide_tile(input, tile, other);
    return insert(input, slot);
  }
  Occupancy& occupancy = occupancy_[tile];
  const auto k = static_cast<std::size_t>(std::countr_one(occupancy.taken));
  places_[slot] = static_cast<std::uint32_t>(tile * node_size + k);
  set_place(input, places_[slot], box, slot);
  extend(all_.bounds[tile], box);
  if (occupancy.taken == 0 || !is_within(box, occupancy.home)) occupancy.home = home_of(all_.bounds[tile]);
  occupancy.taken |= 1U << k;
  ++size_;
  const auto add_to = [&](Node<axes>& parent, std::size_t child, Bounds<axes> bounds) {
    extend(bounds, box);
    parent.set(child, bounds, std::min(parent.index[child], slot));
  };
  const std::size_t root = node / node_size;
  add_to(all_.nodes[node], tile % node_size, all_.bounds[tile]);
  add_to(all_.roots[root], node % node_size, all_.roots[root].get(node % node_size));
  add_to(all_.tops[root / node_size], root % node_size, all_.tops[root / node_size].get(root % node_size));
}

/// @returns A tile of the node; no_slot if it has none that is empty.
template <std::size_t axes>
std::size_t TileTree<axes>::empty_tile(std::size_t node) {
  for (std::size_t tile = node * node_size; tile < (node + 1) * node_size; ++tile) {
    if (tile == all_.tiles.size()) resize(tile + 1);
    if (occupancy_[tile].taken == 0) return tile;
  }
  return no_slot;
}

/// Moves half of the boxes of a full tile to an empty one of the same node.
template <std::size_t axes>
void TileTree<axes>::divide_tile(const Input& input, std::size_t tile, std::size_t other) {
  std::size_t next = other * node_size;
  for_each_bit(upper_half(all_.tiles[tile]), [&](std::size_t k) {
    const std::uint32_t slot = all_.tiles[tile].index[k];
    set_place(input, next, all_.tiles[tile].get(k), slot);
    clear_place(tile * node_size + k);
    places_[slot] = static_cast<std::uint32_t>(next++);
  });
  occupancy_[other].taken = (1U << node_size / 2) - 1;
  for (const std::size_t half : {tile, other}) {
    all_.bounds[half] = bounds_of(all_.tiles[half]);
    occupancy_[half].home = home_of(all_.bounds[half]);
  }
  update_node(tile / node_size, ~0U);
}

/// Moves half of the tiles of a full node to a new one.
template <std::size_t axes>
void TileTree<axes>::divide_node(std::size_t node) {
  std::size_t next = all_.nodes.size() * node_size;
  resize(next + node_size / 2);
  read_nodes_ = all_.nodes.size();
  for_each_bit(upper_half(all_.nodes[node]), [&](std::size_t k) {
    const std::size_t tile = node * node_size + k;
    std::swap(all_.tiles[tile], all_.tiles[next]);
    if (all_.reaches) std::swap(all_.boxes[tile], all_.boxes[next]);
    std::swap(all_.bounds[tile], all_.bounds[next]);
    std::swap(occupancy_[tile], occupancy_[next]);
    for_each_bit(occupancy_[next].taken, [&](std::size_t child) {
      places_[all_.tiles[next].index[child]] = static_cast<std::uint32_t>(next * node_size + child);
    });
    ++next;
  });
  for (const std::size_t half : {node, all_.nodes.size() - 1}) {
    update_node(half, ~0U);
    update_root(half / node_size);
  }
}

template class TileTree<3>;
template class TileTree<4>;

}  // namespace broadcl
