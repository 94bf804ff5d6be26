// The order of the tiles of sweep and prune.
#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <random>
#include <set>
#include <span>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "each_algorithm.hpp"
#include "finders/tile_search.hpp"
#include "finders/tile_sort.hpp"

namespace broadcl::test {
namespace {

constexpr std::size_t whole = std::numeric_limits<std::size_t>::max();

std::vector<Aabb> points(std::size_t count, const std::vector<float>& coordinates) {
  std::mt19937 random(3);
  std::uniform_int_distribution<std::size_t> index(0, coordinates.size() - 1);
  std::vector<Aabb> boxes(count);
  for (Aabb& box : boxes) {
    for (float& bound : box.lower) bound = coordinates[index(random)];
    box.upper = box.lower;
  }
  return boxes;
}

Input input_of(const std::vector<Aabb>& boxes, const std::vector<Filter>& filters = {}) {
  Input input;
  input.boxes = boxes;
  input.rules.filters = filters;
  input.rules.worlds = !filters.empty();
  return input;
}

template <std::size_t axes = 3>
TileOrder order_of(const Input& input, std::size_t work = whole, std::size_t threads = 1) {
  TileSort<axes> sort(input, threads);
  while (!sort.advance(work, threads)) {
  }
  return sort.order();
}

/// @param empty A slot without a box.
void expect_each_once(const TileOrder& order, std::size_t slots, std::uint32_t empty = no_slot) {
  ASSERT_EQ(order.places.size(), slots);
  for (std::uint32_t slot = 0; slot < slots; ++slot) {
    if (slot == empty) {
      EXPECT_EQ(order.places[slot], no_slot);
      continue;
    }
    ASSERT_LT(order.places[slot], order.slots.size());
    EXPECT_EQ(order.slots[order.places[slot]], slot);
  }
  EXPECT_EQ(std::ranges::count(order.slots, no_slot),
            static_cast<std::ptrdiff_t>(order.slots.size() - slots + (empty == no_slot ? 0 : 1)));
}

/// The sum of the edges of the tiles.
double extent_of(const TileOrder& order, std::span<const Aabb> boxes) {
  double sum = 0;
  for (std::size_t first = 0; first < order.slots.size(); first += node_size) {
    Bounds<3> bounds = make_bounds<3>(infinity, -infinity);
    for (std::size_t k = first; k < std::min(order.slots.size(), first + node_size); ++k) {
      if (order.slots[k] == no_slot) continue;
      const Aabb& box = boxes[order.slots[k]];
      extend(bounds, Bounds<3>{.lower = box.lower, .upper = box.upper});
    }
    for (std::size_t axis = 0; axis < 3; ++axis)
      sum += static_cast<double>(bounds.upper[axis] - bounds.lower[axis]);
  }
  return sum;
}

TEST(TileSort, PutsTheBoxesOfEachCellIntoATile) {
  std::vector<Aabb> boxes;  // a grid of 16 x 16 x 16, the slots of which are permuted
  for (std::uint32_t k = 0; k < 4096; ++k) {
    const std::uint32_t at = k * 2731 % 4096;
    const std::uint32_t layer = at / 256;
    Aabb& box = boxes.emplace_back();
    box.lower = {static_cast<float>(at % 16), static_cast<float>(at / 16 % 16), static_cast<float>(layer)};
    box.upper = box.lower;
  }
  const TileOrder order = order_of(input_of(boxes));
  expect_each_once(order, boxes.size());
  EXPECT_EQ(extent_of(order, boxes), 128 * (3 + 3 + 1)) << "a tile has 4 x 4 x 2 points";
}

TEST(TileSort, PutsEachBoxAtOnePlace) {
  const float largest = std::numeric_limits<float>::max();
  const float least = std::numeric_limits<float>::denorm_min();
  const std::vector<std::vector<float>> kinds{
      {0},        {-1, 1},        {-infinity, 0, infinity}, {-largest, largest, 1}, {-least, 0, least},
      {-0.0F, 0}, {1, 1.0000001F}};
  for (const std::vector<float>& coordinates : kinds) {
    for (const std::size_t count : {1U, 31U, 32U, 33U, 64U, 65U, 1000U, 1025U, 5000U}) {
      SCOPED_TRACE(testing::Message() << count << " boxes near " << coordinates.front());
      const std::vector<Aabb> boxes = points(count, coordinates);
      expect_each_once(order_of(input_of(boxes)), count);
    }
  }
}

TEST(TileSort, IsTheSameInStepsAndWithThreads) {
  std::vector<float> coordinates(1000);
  for (std::size_t k = 0; k < coordinates.size(); ++k) coordinates[k] = static_cast<float>(k) / 7;
  std::vector<Aabb> boxes = points(20'000, coordinates);
  for (std::size_t k = 0; k < boxes.size(); k += 5) boxes[k].upper[k % 3] += 40;  // a second class
  const Input input = input_of(boxes);
  const TileOrder expected = order_of(input);
  expect_each_once(expected, boxes.size());
  for (const std::size_t work : {std::size_t{1}, std::size_t{30'000}, whole}) {
    for (const std::size_t threads : {1U, 4U}) {
      const TileOrder order = order_of(input, work, threads);
      EXPECT_EQ(order.slots, expected.slots) << work << ", " << threads;
      EXPECT_EQ(order.places, expected.places) << work << ", " << threads;
    }
  }
}

TEST(TileSort, DoesAboutAsMuchWorkInAStepAsItIsTold) {
  const std::vector<Aabb> boxes = points(50'000, {1, 2, 3, 4, 5, 6, 7, 8, 9});
  TileSort<3> sort(input_of(boxes), 1);
  const std::size_t share = sort.work() / 4;
  std::size_t steps = 1;
  while (!sort.advance(share, 1)) ++steps;
  EXPECT_GE(steps, 3U);
  EXPECT_LE(steps, 5U);
}

TEST(TileSort, SeparatesSizesAndWorlds) {
  std::vector<Aabb> boxes = points(2048, {1, 2, 3, 4, 5, 6, 7, 8});
  std::vector<Filter> filters(boxes.size());
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    filters[k].world = static_cast<std::uint32_t>(k % 4);
    for (float& bound : boxes[k].upper) bound += k < 512 ? 100 : 1;
  }
  filters[1000].world = Filter::all_worlds;
  boxes[1001] = {{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}};
  const TileOrder order = order_of<4>(input_of(boxes, filters));
  expect_each_once(order, boxes.size(), 1001);
  const auto kind_of = [&](std::uint32_t slot) {
    if (slot == 1000) return slot;
    return filters[slot].world + (slot < 512 ? 10 : 20);
  };
  std::size_t mixed = 0;  // tiles
  for (std::size_t first = 0; first < order.slots.size(); first += node_size) {
    std::set<std::uint32_t> kinds;
    for (std::size_t k = first; k < std::min(order.slots.size(), first + node_size); ++k) {
      if (order.slots[k] != no_slot) kinds.insert(kind_of(order.slots[k]));
    }
    mixed += static_cast<std::size_t>(kinds.size() > 1);
  }
  EXPECT_LE(mixed, 8U) << "of 65; the worlds do not end where tiles do";
}

TEST(TileSort, SeparatesFiltersThatRefuseManyObjects) {
  const std::vector<Aabb> boxes = points(2000, {1, 2, 3, 4});
  std::vector<Filter> filters;
  for (std::uint32_t k = 0; k < boxes.size(); ++k) {
    if (k % 10 < 5) {
      filters.push_back({.group = 2, .mask = 5});
    } else {
      filters.push_back({.group = k % 10 == 5 ? 4U : 1U, .mask = 0xffffffff, .body = k});
    }
  }
  Input input = input_of(boxes, filters);
  input.rules.worlds = false;
  const auto mixed_tiles = [&] {
    const TileOrder order = order_of(input);
    expect_each_once(order, boxes.size());
    std::size_t mixed = 0;
    for (std::size_t first = 0; first < order.slots.size(); first += node_size) {
      std::uint32_t groups = 0;
      for (std::size_t k = first; k < std::min(order.slots.size(), first + node_size); ++k) {
        if (order.slots[k] != no_slot) groups |= filters[order.slots[k]].group;
      }
      mixed += static_cast<std::size_t>((groups & 2U) != 0 && groups != 2);
    }
    EXPECT_EQ(order.is_by_filter, mixed == 0);
    return mixed;
  };
  EXPECT_EQ(mixed_tiles(), 0U);
  for (Filter& filter : filters) filter.mask |= 2U;
  EXPECT_GT(mixed_tiles(), 50U) << "of 63: now all may pair";
}

TEST(TileSort, SeparatesDirectionsIfThatPays) {
  const auto mixed_tiles = [](float length) {
    std::mt19937 random(3);
    std::uniform_real_distribution<float> place(0, 20);
    std::vector<Aabb> boxes(3200);
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        boxes[k].lower[axis] = place(random);
        boxes[k].upper[axis] = boxes[k].lower[axis] + (axis == k % 3 ? length : 0.5F);
      }
    }
    const TileOrder order = order_of(input_of(boxes));
    expect_each_once(order, boxes.size());
    std::size_t mixed = 0;
    for (std::size_t first = 0; first < order.slots.size(); first += node_size) {
      std::set<std::uint32_t> directions;
      for (std::size_t k = first; k < std::min(order.slots.size(), first + node_size); ++k) {
        if (order.slots[k] != no_slot) directions.insert(order.slots[k] % 3);
      }
      mixed += static_cast<std::size_t>(directions.size() > 1);
    }
    return mixed;
  };
  EXPECT_EQ(mixed_tiles(15), 0U);
  EXPECT_GT(mixed_tiles(2), 90U) << "of 100: tiles extend as far as boxes";
}
/// Boxes move, leap, come and go, and get filters and worlds, while new orders are being made.
TEST(SweepAndPrune, FindsWhatChangesWhileItSorts) {
  BroadPhase tested({.algorithm = "sweep-and-prune", .threads = 2});
  BroadPhase reference({.algorithm = "oracle"});
  const auto both = [&](const auto& function) {
    function(tested);
    function(reference);
  };
  std::mt19937 random(5);
  std::uniform_real_distribution<float> place(0, 12);
  std::uniform_real_distribution<float> step(-0.3F, 0.3F);
  std::vector<std::uint32_t> ids;
  std::vector<Aabb> boxes;  // by id
  const auto add = [&](std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) {
      const std::array<float, 3> lower{place(random), place(random), place(random)};
      const Aabb box{lower, {lower[0] + 1, lower[1] + 1, lower[2] + 1}};
      const std::uint32_t id = tested.add(box);
      ASSERT_EQ(reference.add(box), id);
      ids.push_back(id);
      boxes.resize(std::max<std::size_t>(boxes.size(), id + 1));
      boxes[id] = box;
    }
  };
  add(500);
  for (int frame = 0; frame < 200; ++frame) {
    const bool leap = frame == 60 || frame == 61 || frame == 130;
    const std::size_t moving = frame % 10 == 7 ? 5 : ids.size();
    for (std::size_t k = 0; k < moving; ++k) {
      Aabb& box = boxes[ids[k]];
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float lower = leap ? place(random) : box.lower[axis] + step(random);
        box.lower[axis] = lower;
        box.upper[axis] = lower + 1;
      }
      both([&](BroadPhase& broad_phase) { broad_phase.move(ids[k], box); });
    }
    if (frame % 10 == 3) {
      for (int k = 0; k < 60; ++k) {
        std::swap(ids[random() % ids.size()], ids.back());
        both([&](BroadPhase& broad_phase) { broad_phase.remove(ids.back()); });
        ids.pop_back();
      }
      add(frame == 103 ? 400 : 90);
    }
    if (frame == 20 || frame == 47) {
      for (std::size_t k = 0; k < (frame == 20 ? ids.size() : 3); ++k) {
        const Filter filter = frame == 20 && k % 4 != 0 ? Filter{.group = 2, .mask = ~2U} : Filter();
        both([&](BroadPhase& broad_phase) { broad_phase.set_filter(ids[k], filter); });
      }
    }
    if (frame == 90 || frame == 150) {
      for (const std::uint32_t id : ids)
        both([&](BroadPhase& broad_phase) {
          broad_phase.set_filter(id, {.world = frame == 90 ? id % 3 : 0});
        });
    }
    if (frame == 120) both([](BroadPhase& broad_phase) { broad_phase.shrink(); });
    const Delta found = tested.update();
    const Delta expected = reference.update();
    ASSERT_TRUE(std::ranges::equal(found.added, expected.added)) << frame;
    ASSERT_TRUE(std::ranges::equal(found.removed, expected.removed)) << frame;
  }
}

}  // namespace
}  // namespace broadcl::test
