#pragma once

#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <limits>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include "device_twins.hpp"
#include "each_algorithm.hpp"
#include "trouble.hpp"
#include "twins.hpp"
#include "warped.hpp"

/// Short lives in which everything happens once; in each, another call or allocation fails.
namespace broadcl::test {

/// Options of a life.
struct Habits {
  /// Whether objects get worlds, for which some algorithms build a kernel in the middle of a life.
  bool worlds = true;
  /// Updates at the beginning in which one object moves.
  int updates = 0;
  /// In double precision: which Warp.
  unsigned warp = 0;
};

/// A box in a row.
inline Aabb in_row(std::size_t k, float distance = 0.7F) {
  const float x = static_cast<float>(k) * distance;
  return {{x, 0, 0}, {x + 1, 1, 1}};
}

inline std::vector<Aabb> row(std::size_t n, float distance) {
  std::vector<Aabb> boxes;
  for (std::size_t k = 0; k < n; ++k) boxes.push_back(in_row(k, distance));
  return boxes;
}

/// Calls every function over a few frames.
template <class Subject, class Trouble>
[[nodiscard]] ::testing::AssertionResult live(Twins<Subject, Trouble>& twins, const Habits& habits) try {
  if constexpr (requires { twins.tested().set_warp(Warp()); }) twins.tested().set_warp(Warp(habits.warp));
  ::testing::AssertionResult result = ::testing::AssertionSuccess();
  const auto update = [&] {
    if (result) result = twins.agree();
  };
  const auto map = [&](std::size_t n, float distance) {
    twins.map(n, [&](std::span<Aabb> boxes) {
      for (std::size_t k = 0; k < n; ++k) boxes[k] = in_row(k, distance);
    });
    update();
  };
  for (std::uint32_t k = 0; k < 10; ++k)
    twins.add(in_row(k), {.group = 1U + k % 2, .mask = k % 5 == 0 ? 1U : 3U});
  update();
  for (int k = 0; k < habits.updates; ++k) {
    twins.move(3, in_row(k % 2 == 0 ? 5 : 3));
    update();
  }
  const std::vector<std::uint32_t> first{0, 1, 6};
  const auto set_reach = [&](float reach) {
    if (twins.has_reaches()) twins.set_reach(first, std::vector{reach});
  };
  set_reach(0.4F);
  twins.move(3, in_row(7));
  twins.set_filter(4, {.mask = 0});
  twins.set_exclusions(Pairs{{1, 3}, {0, 1}});
  twins.remove(2);
  twins.add(in_row(1));
  twins.remove(9);
  twins.begin();
  set_reach(1.5F);
  twins.move(1, in_row(4));
  twins.remove(5);
  twins.add(in_row(6), {.body = 1});
  for (std::uint32_t k = 0; k < 30; ++k) twins.add(in_row(k), {.body = k % 4});
  twins.set_filter(0, {.world = habits.worlds ? 1U : 0U});
  update();
  update();
  const auto saved = twins.save();
  const auto restore = [&] {
    if (result) result = twins.restore(saved);
  };
  map(20, 1);
  map(200, 0.001F);  // all pair
  std::vector<std::uint32_t> some(49);
  std::iota(some.begin(), some.end(), 0U);
  std::vector<Aabb> far = row(some.size(), 0.5F);
  for (Aabb& box : far) box.lower[2] = box.upper[2] = -100 + box.lower[0];
  twins.move(some, far);
  update();
  twins.move(0, in_row(0));
  update();
  map(200, 0.001F);
  twins.begin();
  twins.move(5, in_row(500));
  update();
  update();
  twins.shrink();
  map(12, 0.5F);
  twins.remove(11);
  twins.shrink();
  update();
  twins.add(in_row(2));
  twins.move(0, in_row(1));
  update();
  twins.add(row(6, 0.4F), std::vector<Filter>(6, {.body = 1}));
  twins.move(std::vector<std::uint32_t>{2, 4, 12}, row(3, 0.2F));
  twins.remove(std::vector<std::uint32_t>{3, 13});
  // Of the same boxes few differ, which is noticed one frame later.
  std::vector<Aabb> boxes = row(14, 0.6F);
  const auto give = [&] {
    if (result) result = twins.agree(BoxView(boxes), [](const auto& /*delta*/) {});
  };
  give();
  boxes[5] = in_row(2);
  give();
  boxes[6] = in_row(3);
  give();
  boxes.resize(12);
  give();
  boxes = row(40, 0.6F);
  twins.begin(BoxView(boxes));
  update();
  twins.set_exclusions(Pairs{{4, 9}});
  set_reach(0.3F);
  twins.remove(7);
  restore();
  restore();  // which changes nothing
  twins.move(1, in_row(9));
  twins.remove(0);
  twins.add(in_row(3));
  restore();
  update();
  return result;
} catch (const std::exception& error) {
  return ::testing::AssertionFailure() << "a call fails by itself: " << error.what();
}

/// The same with objects on the device.
template <class Trouble>
[[nodiscard]] ::testing::AssertionResult live(DeviceTwins<Trouble>& twins) try {
  /// Boxes in a row, in as many groups as requested.
  const auto row = [](std::uint32_t n, float distance, std::uint32_t groups = 0) {
    DeviceFrame frame;
    for (std::uint32_t k = 0; k < n; ++k) {
      frame.boxes.push_back(in_row(k, distance));
      if (groups > 0) frame.filters.push_back({.mask = k % groups == 0 ? 0U : 1U, .body = k / groups});
    }
    return frame;
  };
  ::testing::AssertionResult result = ::testing::AssertionSuccess();
  const auto update = [&](const DeviceFrame& frame) {
    if (result) result = twins.update(frame);
  };
  const auto enqueue = [&](const DeviceFrame& frame) {
    constexpr std::size_t most_changes = 435;  // every pair of 30
    twins.reserve(30, 2 * most_changes);
    twins.enqueue(frame, most_changes);
    if (result) result = twins.agree();
  };
  update(row(20, 0.7F));
  update(row(30, 0.6F, 3));
  update(row(200, 0.001F));  // all pair
  twins.shrink();
  update(row(25, 0.3F, 5));
  twins.shrink();
  enqueue(row(28, 0.5F, 3));
  enqueue(row(30, 0.4F));
  update(row(0, 1));
  update(row(24, 0.4F));
  return result;
} catch (const std::exception& error) {
  return ::testing::AssertionFailure() << "a call fails by itself: " << error.what();
}

/// Runs one life in which nothing fails, then one for each point at which something may fail.
/// @param most If there are more points, about this many, evenly spread.
/// @param live Takes the point that fails first, and returns how many points there were, or none after a
/// wrong answer.
template <class Function>
void expect_right_lives(long most, const Function& live) {
  const std::optional<long> points = live(std::numeric_limits<long>::max());
  ASSERT_TRUE(points) << "although nothing fails";
  const long step = std::max(1L, (*points + most - 1) / most);
  for (long first = 0; first < *points; first += step) {
    ASSERT_TRUE(live(first)) << "failure " << first << " of " << *points;
  }
}

/// Nothing has to be as before a life.
struct NoWatch {
  void expect_nothing_left(long /*failures*/) const {}
};

/// Runs lives of twins that are made by a function.
/// @tparam Watch Made before a life; afterwards, it checks that nothing is left of it.
/// @param count How many calls fail in each.
template <class Watch, class Trouble, class Make, class Live>
void expect_right_lives_of(long count, long most, const Make& make, const Live& live_one) {
  expect_right_lives(most, [&](long first) -> std::optional<long> {
    const Watch watch;
    long points = 0;
    {
      auto twins = make(Trouble(first, count), first % 4 < 2);
      const ::testing::AssertionResult result = live_one(twins);
      EXPECT_TRUE(result);
      if (!result) return std::nullopt;
      points = twins.trouble().points();
    }
    watch.expect_nothing_left(count);
    return points;
  });
}

template <class Trouble, class Watch = NoWatch, class Tested = BroadPhase, unsigned warp = 0>
void expect_short_lives(const BroadPhase::Config& config, long count, long most, bool worlds = true) {
  using Subject = Twins<Tested, Trouble>;
  expect_right_lives_of<Watch, Trouble>(
      count, most,
      [&](const Trouble& trouble, bool looks) { return Subject(std::in_place, trouble, looks, config); },
      [&](Subject& twins) { return live(twins, {.worlds = worlds, .warp = warp}); });
}

template <class Trouble, class Watch = NoWatch>
void expect_device_lives(const std::string& algorithm, long count, long most) {
  const CallersQueue queue;
  expect_right_lives_of<Watch, Trouble>(
      count, most,
      [&](const Trouble& trouble, bool looks) {
        return DeviceTwins<Trouble>(queue, {.algorithm = algorithm}, trouble, looks);
      },
      [](DeviceTwins<Trouble>& twins) { return live(twins); });
}

}  // namespace broadcl::test
