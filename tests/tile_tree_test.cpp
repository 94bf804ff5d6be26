// The tiles of sweep and prune while boxes come, go and leap.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "base/packed_box.hpp"
#include "each_algorithm.hpp"
#include "finders/tile_search.hpp"
#include "finders/tile_sort.hpp"
#include "finders/tile_tree.hpp"

namespace broadcl::test {
namespace {

constexpr std::size_t everything = std::numeric_limits<std::size_t>::max();

Aabb box_at(float x, float y, float z) {
  return {{x, y, z}, {x + 1, y + 1, z + 1}};
}

/// A tree of boxes, and the boxes.
class Tree {
 public:
  explicit Tree(std::size_t count) : boxes(count) {
    for (Aabb& box : boxes) box = anywhere();
    fill();
  }

  Aabb anywhere() { return box_at(place_(random_), place_(random_), place_(random_)); }

  void fill() {
    TileSort<3> sort(input(), 1);
    while (!sort.advance(everything, 1)) {
    }
    tree.start(sort.order(), input());
    EXPECT_TRUE(tree.read(input(), everything, 1));
    tree.insert(input());
  }

  /// @returns How many boxes were put into other tiles.
  std::size_t update(const std::vector<std::uint32_t>& slots) {
    changed = slots;
    return update(input());
  }
  std::size_t update_all() {
    Input all = input();
    all.changed = {.all = true};
    return update(all);
  }

  [[nodiscard]] Input input() const {
    Input input;
    input.boxes = boxes;
    input.changed.slots = changed;
    return input;
  }

  /// The pairs of tiles that overlap.
  std::size_t overlaps_of_tiles() {
    std::size_t count = 0;
    const HostTiles<3>& all = tree.tiles();
    for (const Bounds<3>& s : all.bounds) {
      for (const Bounds<3>& t : all.bounds) count += static_cast<std::size_t>(packed_overlaps<3>(s, t));
    }
    return count;
  }

  void expect_valid() {
    const HostTiles<3>& all = tree.tiles();
    std::size_t placed = 0;
    for (std::uint32_t slot = 0; slot < std::max(boxes.size(), tree.slots()); ++slot) {
      const bool exists = slot < boxes.size() && !is_empty(boxes[slot]);
      const std::uint32_t place = tree.place_of(slot);
      ASSERT_EQ(place != no_slot, exists) << slot;
      if (!exists) continue;
      ++placed;
      ASSERT_EQ(all.tiles.at(place / node_size).index[place % node_size], slot);
      const Bounds<3> box = all.tiles[place / node_size].get(place % node_size);
      ASSERT_EQ(box.lower, boxes[slot].lower);
      ASSERT_EQ(box.upper, boxes[slot].upper);
    }
    EXPECT_EQ(tree.size(), placed);
    std::size_t stored = 0;
    for (std::size_t tile = 0; tile < all.tiles.size(); ++tile) {
      stored += node_size - static_cast<std::size_t>(std::ranges::count(all.tiles[tile].index, no_slot));
      expect_bounds(all.bounds[tile], all.tiles[tile]);
      const Bounds<3> child = all.nodes.at(tile / node_size).get(tile % node_size);
      if (std::isnan(child.lower[0])) {
        ASSERT_EQ(all.bounds[tile].lower[0], infinity) << "of an empty tile";
        continue;
      }
      ASSERT_EQ(child.lower, all.bounds[tile].lower);
      ASSERT_EQ(child.upper, all.bounds[tile].upper);
    }
    EXPECT_EQ(stored, placed) << "free places have no box";
    expect_parents(all.nodes, all.tiles);
    expect_parents(all.roots, all.nodes);
    expect_parents(all.tops, all.roots);
  }

  std::vector<Aabb> boxes;
  std::vector<std::uint32_t> changed;
  TileTree<3> tree{false, false};

 private:
  std::size_t update(const Input& input) {
    EXPECT_TRUE(tree.read(input, everything, 2));
    const std::size_t left = tree.left().size();
    tree.insert(input);
    return left;
  }
  /// No parent has a slot that is greater than one below it, so none is left out.
  static void expect_parents(const std::vector<Node<3>>& parents, const std::vector<Node<3>>& children) {
    ASSERT_EQ(parents.size(), (children.size() + node_size - 1) / node_size);
    for (std::size_t k = 0; k < children.size(); ++k) {
      const Node<3>& parent = parents[k / node_size];
      if (std::isnan(parent.lower[0][k % node_size])) continue;  // has been empty all the time
      expect_bounds(parent.get(k % node_size), children[k]);
      ASSERT_LE(parent.index[k % node_size], std::ranges::min(children[k].index));
    }
  }
  static void expect_bounds(const Bounds<3>& bounds, const Node<3>& node) {
    Bounds<3> expected = make_bounds<3>(infinity, -infinity);
    for (std::size_t k = 0; k < node_size; ++k) extend(expected, node.get(k));
    ASSERT_EQ(bounds.lower, expected.lower);
    ASSERT_EQ(bounds.upper, expected.upper);
  }

  std::mt19937 random_{1};
  std::uniform_real_distribution<float> place_{0, 30};
};

TEST(TileTree, StaysGoodWhileBoxesLeap) {
  for (const bool all : {false, true}) {
    Tree tree(5000);
    const std::size_t sorted = tree.overlaps_of_tiles();
    for (std::uint32_t frame = 0; frame < 40; ++frame) {
      std::vector<std::uint32_t> leap;
      for (std::uint32_t slot = frame; slot < 5000; slot += 50) leap.push_back(slot);
      for (const std::uint32_t slot : leap) tree.boxes[slot] = tree.anywhere();
      EXPECT_GT(all ? tree.update_all() : tree.update(leap), leap.size() / 2);
      tree.expect_valid();
    }
    EXPECT_LT(tree.overlaps_of_tiles(), 5 * sorted) << "up to twice as many tiles";
  }
}

TEST(TileTree, LeavesBoxesThatTrembleInTheirTiles) {
  Tree tree(2000);
  std::vector<std::uint32_t> slots(2000);
  std::iota(slots.begin(), slots.end(), 0U);
  for (const float step : {0.25F, -0.25F, 0.125F}) {
    for (Aabb& box : tree.boxes) {
      box.lower[0] += step;
      box.upper[0] += step;
    }
    EXPECT_EQ(tree.update(slots), 0U);
    tree.expect_valid();
    EXPECT_FALSE(tree.tree.is_abandoned(tree.input()));
  }
  std::ranges::reverse(tree.boxes);
  EXPECT_TRUE(tree.tree.is_abandoned(tree.input()));
}

TEST(TileTree, TakesBoxesThatComeAndGo) {
  for (const bool all : {false, true}) {
    Tree tree(100);
    const auto update = [&](const std::vector<std::uint32_t>& slots) {
      all ? tree.update_all() : tree.update(slots);
      tree.expect_valid();
    };
    std::vector<std::uint32_t> slots;
    for (std::uint32_t slot = 100; slot < 3000; ++slot) {
      slots.push_back(slot);
      tree.boxes.push_back(tree.anywhere());
    }
    update(slots);
    for (const std::uint32_t slot : slots) tree.boxes[slot] = packed_empty();
    update(slots);
    EXPECT_EQ(tree.tree.size(), 100U);
    for (const std::uint32_t slot : slots) tree.boxes[slot] = box_at(1, 2, 3);  // all at one place
    update(slots);
    tree.boxes.resize(10);
    slots.resize(2990);
    std::iota(slots.begin(), slots.end(), 10U);
    update(slots);
    EXPECT_EQ(tree.tree.size(), 10U);
  }
}

TEST(TileTree, IsReadInParts) {
  Tree tree(5000);
  TileSort<3> sort(tree.input(), 1);
  while (!sort.advance(everything, 1)) {
  }
  tree.boxes.push_back(tree.anywhere());  // since then
  tree.boxes[7] = packed_empty();
  tree.changed = {1, 2, 3, 5000};
  tree.tree.start(sort.order(), tree.input());
  EXPECT_EQ(tree.tree.left().size(), 1U);
  tree.tree.take_out(8);
  std::size_t parts = 1;
  for (; !tree.tree.read(tree.input(), 1, 1); ++parts) {
    for (const std::uint32_t slot : tree.changed) tree.boxes[slot] = tree.anywhere();
  }
  EXPECT_EQ(parts, 5U);
  tree.tree.insert(tree.input());
  tree.expect_valid();
}

TEST(TileTree, TakesBoxesWithoutLimits) {
  Tree tree(40);
  std::vector<std::uint32_t> slots;
  for (std::uint32_t slot = 0; slot < 200; ++slot) {
    slots.push_back(slot);
    if (slot >= 40) tree.boxes.emplace_back();
    Aabb& box = tree.boxes[slot] = tree.anywhere();
    if (slot % 3 == 0) box.upper[slot % 2] = infinity;
    if (slot % 5 == 0) box.lower[slot % 3] = -infinity;
    if (slot % 7 == 0) box.lower[0] = box.upper[0] = infinity;
    if (slot % 11 == 0) box.lower = {-infinity, -infinity, -infinity};
  }
  tree.update(slots);
  tree.expect_valid();
  tree.update_all();
  tree.expect_valid();
  tree.fill();
  tree.expect_valid();
}

}  // namespace
}  // namespace broadcl::test
