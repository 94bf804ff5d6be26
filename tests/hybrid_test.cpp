#include "engines/hybrid.hpp"

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <new>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/device.hpp>
#include <broadcl/error.hpp>

#include "core/core.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "expect_error.hpp"
#include "patience.hpp"
#include "pretender.hpp"
#include "runs.hpp"
#include "twins.hpp"

namespace broadcl::test {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr double at_once = 0;
constexpr double slow_update = 100e-6;

AlgorithmPointer host() {
  return make_algorithm({.algorithm = "sweep-and-prune"});
}

/// Opens its device after a few updates, even if they take no time.
/// @param orders Must outlive it.
AlgorithmPointer hybrid(const Pretender::Orders& orders) {
  return make_hybrid(
      host(), [&orders] { return std::make_unique<Pretender>(orders); }, at_once);
}

/// Calls update() until is_done(). (The device is opened in another thread.)
template <class Function, class Condition>
void repeat_until(const Condition& is_done, const Function& update) {
  const auto start = std::chrono::steady_clock::now();
  while (!is_done()) {
    ASSERT_LT(std::chrono::steady_clock::now() - start, patience) << "still not";
    update();
  }
}

TEST(HybridFailure, NoMemoryOnTheDeviceLaterLeavesTheHost) {
  Pretender::Orders orders;
  Twins<Core<Aabb>> twins(std::in_place, NoTrouble(), false, hybrid(orders));
  for (std::uint32_t k = 0; k < 40; ++k) twins.add(apart(k), {});
  std::uint32_t turn = 0;
  const auto update = [&] {
    ++turn;
    for (std::uint32_t k = 0; k < 40; ++k) twins.move(k, apart((k + turn) % 39));
    ASSERT_TRUE(twins.agree());
  };
  const Algorithm& algorithm = twins.tested().algorithm();
  repeat_until([&] { return algorithm.memory().device > 0; }, update);
  orders = {.expected_seconds = at_once, .has_no_memory = true};
  for (int k = 0; k < 50; ++k) update();
  EXPECT_EQ(algorithm.device(), nullptr);
  orders.has_no_memory = false;
  repeat_until([&] { return algorithm.device() != nullptr; }, update);
}

/// Moves a box to and fro until the next update runs on the device, or on the host.
/// @param expected_seconds Of an update on the device.
void move_until(Core<Aabb>& core, Pretender::Orders& orders, bool is_on_device, double expected_seconds) {
  orders.expected_seconds = expected_seconds;
  std::size_t at = 1;
  repeat_until([&] { return (core.algorithm().device() != nullptr) == is_on_device; },
               [&] {
                 core.move(0, apart(at));
                 (void)core.finish();
                 at = 3 - at;
               });
}

/// Adds three equal boxes, and moves one away until the next update runs on the device, in which it returns.
void meet_on_host(Core<Aabb>& core, Pretender::Orders& orders) {
  for (std::uint32_t k = 0; k < 3; ++k) core.add(unit, {});
  EXPECT_EQ(core.finish().added.size(), 3U);
  move_until(core, orders, true, at_once);
  core.move(0, unit);
}

TEST(HybridSwitch, AnIdThatIsUsedAgainForTheFirstUpdateOnTheDeviceIsAnotherObject) {
  Pretender::Orders orders;
  Core<Aabb> core(hybrid(orders));
  meet_on_host(core, orders);
  core.remove(2);
  EXPECT_EQ(core.add(unit, {}), 2U);
  const Delta delta = core.finish();
  EXPECT_THAT(to_vector(delta.added), ::testing::IsSupersetOf(Pairs{{0, 2}, {1, 2}}));
  EXPECT_THAT(to_vector(delta.removed), ::testing::Contains(Pair{1, 2}));
}

/// After a failure on the device, the pairs are as before, and the host finds what has changed since.
void expect_nothing_lost(Core<Aabb>& core, const Pairs& before) {
  EXPECT_EQ(core.algorithm().device(), nullptr);
  EXPECT_EQ(core.pairs(), before);
  core.move(1, apart(2));
  const Delta delta = core.finish();
  EXPECT_EQ(to_vector(delta.added), Pairs());
  EXPECT_EQ(to_vector(delta.removed), before);
}

TEST(HybridFailure, OfTheFirstUpdateOnTheDeviceLosesNothing) {
  for (const std::string function : {"finish", "pairs"}) {
    SCOPED_TRACE(function);
    Pretender::Orders orders;
    Core<Aabb> core(hybrid(orders));
    meet_on_host(core, orders);
    if (function == "pairs") {  // which is called if the device returns what changed since it was left
      (void)core.finish();
      move_until(core, orders, false, 1e6);  // much more than a change is taken to cost
      move_until(core, orders, true, at_once);
      core.move(0, unit);
    }
    core.remove(2);
    const Pairs before = core.pairs();
    orders.fails = function;
    EXPECT_EQ(error_of([&] { (void)core.finish(); }), "the device failed");
    expect_nothing_lost(core, before);
    EXPECT_EQ(core.pairs(), Pairs());
  }
}

/// Moves to the device, fails there in a function, and continues on the host.
void fail_on_device(const std::string& function) {
  SCOPED_TRACE(function);
  Pretender::Orders orders;
  Core<Aabb> core(hybrid(orders));
  meet_on_host(core, orders);
  (void)core.finish();
  ASSERT_NE(core.algorithm().device(), nullptr);
  const Pairs before = core.pairs();
  ASSERT_EQ(before.size(), 3U);
  orders.fails = function;
  core.move(2, apart(3));
  EXPECT_EQ(error_of([&] {
              core.begin();
              core.flush();
              (void)core.finish();
            }),
            "the device failed");
  expect_nothing_lost(core, before);
  EXPECT_EQ(core.algorithm().memory().device, 0U) << "of the device";
  for (int k = 0; k < 100; ++k) {
    core.move(1, k % 2 == 0 ? unit : apart(2));
    (void)core.finish();
  }
  EXPECT_EQ(core.algorithm().device(), nullptr);
  EXPECT_EQ(core.pairs(), Pairs());
}

TEST(HybridFailure, OnTheDeviceIsFollowedByUpdatesOnTheHost) {
  for (const std::string function : {"reserve_exclusions", "begin", "flush", "finish"}) {
    fail_on_device(function);
  }
}

TEST(HybridFailure, OfADeviceThatNoLongerHasThePairsStaysThere) {
  Pretender::Orders orders;
  Core<Aabb> core(hybrid(orders));
  meet_on_host(core, orders);
  (void)core.finish();
  orders.fails = "finish";
  orders.is_lost = true;
  core.move(2, apart(3));
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(error_of([&] { (void)core.finish(); }), "the device failed");
    EXPECT_NE(core.algorithm().device(), nullptr);
  }
  orders = {.expected_seconds = at_once};
  EXPECT_EQ(to_vector(core.finish().removed), (Pairs{{0, 2}, {1, 2}}));
}

TEST(HybridFailure, NoMemoryOnTheDeviceIsFollowedByUpdatesOnTheHost) {
  Pretender::Orders orders;
  Core<Aabb> core(hybrid(orders));
  meet_on_host(core, orders);
  (void)core.finish();
  ASSERT_NE(core.algorithm().device(), nullptr);
  orders.has_no_memory = true;
  std::string error;
  std::size_t added = 0;
  for (; error.empty() && added < 1000; ++added) {  // until there are more than it has memory for
    try {
      core.add(apart(9), {});
    } catch (const Error& no_memory) {
      error = no_memory.what();
    }
  }
  EXPECT_EQ(error, "no memory");
  EXPECT_EQ(core.algorithm().device(), nullptr);
  EXPECT_EQ(core.size(), 2 + added);
  core.move(2, apart(3));
  const Delta delta = core.finish();
  EXPECT_EQ(to_vector(delta.removed), (Pairs{{0, 2}, {1, 2}}));
  EXPECT_EQ(delta.added.size(), (added - 1) * (added - 2) / 2);
}

/// A hybrid whose host is an algorithm, and that has no device to open.
/// @param calls Counts its attempts to open one; must outlive it.
AlgorithmPointer without_device(int& calls, const std::string& algorithm, double slow) {
  return make_hybrid(
      make_algorithm({.algorithm = algorithm}),
      [&calls]() -> AlgorithmPointer {
        ++calls;
        return nullptr;
      },
      slow);
}

/// Updates with so many boxes that the oracle takes long.
void update_many(Core<Aabb>& core, int updates) {
  constexpr std::uint32_t n = 1000;
  for (int k = 0; k < updates; ++k) {
    const std::span<Aabb> boxes = core.map(n);
    for (std::uint32_t id = 0; id < n; ++id)
      boxes[id] = apart((id + static_cast<std::uint32_t>(k)) % (n - 1));
    (void)core.finish();
    ASSERT_EQ(core.pairs().size(), 1U);
  }
}

TEST(HybridOpens, ADeviceOnceUpdatesTakeLong) {
  const Pretender::Orders orders{.expected_seconds = at_once};
  std::thread::id opened_by;
  Core<Aabb> core(make_hybrid(
      make_algorithm({.algorithm = "oracle"}),
      [&]() -> AlgorithmPointer {
        opened_by = std::this_thread::get_id();
        return std::make_unique<Pretender>(orders);
      },
      slow_update));
  EXPECT_EQ(core.algorithm().memory().device, 0U);
  repeat_until([&] { return core.algorithm().device() != nullptr; }, [&] { update_many(core, 1); });
  EXPECT_NE(opened_by, std::this_thread::get_id());
  update_many(core, 3);
}

TEST(HybridOpens, NoDeviceForFewObjects) {
  int calls = 0;
  {
    Core<Aabb> core(without_device(calls, "sweep-and-prune", slow_update));
    core.add(unit, {});
    for (int k = 0; k < 100; ++k) {
      core.move(0, apart(static_cast<std::size_t>(k % 2)));
      (void)core.finish();
    }
  }
  EXPECT_EQ(calls, 0);
}

TEST(HybridOpens, OnceEvenIfThereIsNone) {
  int calls = 0;
  {
    Core<Aabb> core(without_device(calls, "oracle", slow_update));
    update_many(core, 100);
    EXPECT_EQ(core.algorithm().device(), nullptr);
  }
  EXPECT_EQ(calls, 1);
}

template <class Failure>
void expect_thrown_once(const Failure& failure) {
  int calls = 0;
  Core<Aabb> core(make_hybrid(
      host(),
      [&]() -> AlgorithmPointer {
        ++calls;
        throw Failure(failure);
      },
      at_once));
  for (std::uint32_t k = 0; k < 3; ++k) core.add(unit, {});
  (void)core.finish();
  std::string error;
  std::size_t at = 1;
  repeat_until([&] { return !error.empty(); },
               [&] {
                 core.move(0, apart(at));
                 at = 3 - at;
                 try {
                   (void)core.finish();
                 } catch (const Failure& thrown) {
                   error = thrown.what();
                 }
               });
  EXPECT_EQ(error, failure.what());
  core.move(0, unit);
  core.move(1, apart(1));
  (void)core.finish();
  EXPECT_EQ(core.pairs(), (Pairs{{0, 2}}));
  for (std::size_t k = 1; k < 100; ++k) {
    core.move(0, apart(k));
    (void)core.finish();
  }
  EXPECT_EQ(calls, 1);
}

TEST(HybridOpens, AFailureIsAnErrorOnceAndLosesNothing) {
  expect_thrown_once(Error("the driver is broken"));
  expect_thrown_once(std::bad_alloc());
}

TEST(HybridOpens, AnExceptionOfTheUsersLeavesTheHost) {
  int calls = 0;
  {
    Core<Aabb> core(make_hybrid(
        make_algorithm({.algorithm = "oracle"}),
        [&]() -> AlgorithmPointer {
          ++calls;
          throw std::runtime_error("from Config::on_compile");
        },
        slow_update));
    update_many(core, 100);
    EXPECT_EQ(core.algorithm().device(), nullptr);
  }
  EXPECT_EQ(calls, 1);
}

/// A hybrid of two Pretenders with three boxes, of which one moves in each update. Its time is that of its
/// clock alone.
struct TwoPretenders {
  Time clock;
  Pretender::Orders host_orders{.expected_seconds = 5e-6, .clock = &clock};
  Pretender::Orders device_orders{.clock = &clock};
  std::function<void()> while_opening = [] {};
  Core<Aabb> core;
  std::size_t moves = 0;

  explicit TwoPretenders(double slow)
      : core(make_hybrid(
            std::make_unique<Pretender>(host_orders),
            [this] {
              while_opening();
              return std::make_unique<Pretender>(device_orders);
            },
            slow, 1, [this] { return clock; })) {
    for (std::uint32_t k = 0; k < 3; ++k) core.add(unit, {});
  }

  void update() {
    core.move(0, apart(moves++ % 2));
    (void)core.finish();
  }

  /// Updates that take a while on the host.
  void updates(std::size_t count, microseconds on_host) {
    host_orders.takes = on_host;
    for (; count > 0; --count) update();
  }

  [[nodiscard]] bool is_open() const { return core.algorithm().memory().device > 0; }
};

/// Opening a device takes time on the host, but only once.
TEST(HybridOpens, TheTimesOfUpdatesMeanwhileDoNotCount) {
  std::atomic<bool> is_opening = false;
  std::atomic<bool> may_go_on = false;
  TwoPretenders both(slow_update);
  both.device_orders.expected_seconds = 100e-6;
  both.device_orders.takes = microseconds(100);
  both.while_opening = [&] {
    is_opening = true;
    is_opening.notify_all();
    may_go_on.wait(false);
  };
  both.updates(20, milliseconds(1));
  is_opening.wait(false);
  both.updates(100, milliseconds(20));
  may_go_on = true;
  may_go_on.notify_all();
  repeat_until([&] { return both.is_open(); }, [&] { both.update(); });
  both.updates(100, milliseconds(1));
  EXPECT_GT(both.device_orders.updates, 0);
  both.device_orders.takes = milliseconds(5);
  both.updates(100, milliseconds(1));
  const int before = both.device_orders.updates;
  both.updates(100, milliseconds(1));
  EXPECT_EQ(both.device_orders.updates, before) << "on the device, which is slower";
}

TEST(HybridOpens, ADeviceAlsoAfterUpdatesThatWereTooShortForTheClock) {
  TwoPretenders both(slow_update);
  both.updates(20, microseconds(0));
  both.updates(20, milliseconds(1));
  repeat_until([&] { return both.is_open(); }, [&] { both.update(); });
}

/// What decides is what updates take now, and for how long.
TEST(HybridSwitch, ToADeviceFollowsFromLastingSlownessAlone) {
  TwoPretenders both(slow_update);
  both.device_orders.expected_seconds = 50e-6;
  both.updates(20, milliseconds(1));
  repeat_until([&] { return both.is_open(); }, [&] { both.update(); });
  for (int round = 0; round < 10; ++round) {
    both.updates(1, milliseconds(20));
    both.updates(50, microseconds(10));
  }
  EXPECT_EQ(both.device_orders.updates, 0);
  both.updates(100, milliseconds(1));
  EXPECT_GT(both.device_orders.updates, 0);
}

/// The side that a long time was spent on becomes slow for good: it must not be tried again and again because
/// it was fast on average.
TEST(HybridSwitch, IsSoonFinalAfterALastingChange) {
  TwoPretenders both(slow_update / 10);
  both.device_orders.expected_seconds = 600e-6;
  both.device_orders.takes = microseconds(600);
  both.updates(20, microseconds(200));
  repeat_until([&] { return both.is_open(); }, [&] { both.update(); });
  both.updates(1500, microseconds(200));
  ASSERT_EQ(both.device_orders.updates, 0);
  bool is_on_device = false;
  const auto switches_of = [&](std::size_t updates) {
    std::size_t switches = 0;
    for (; updates > 0; --updates) {
      const int before = both.device_orders.updates;
      both.updates(1, milliseconds(2));
      const bool was_on_device = std::exchange(is_on_device, both.device_orders.updates != before);
      switches += is_on_device == was_on_device ? 0U : 1U;
    }
    return switches;
  };
  EXPECT_LE(switches_of(400), 9U);
  EXPECT_LE(switches_of(100), 1U);
  EXPECT_TRUE(is_on_device);
}

TEST(HybridOpens, NoDeviceForASingleUpdate) {
  int calls = 0;
  {
    Core<Aabb> core(without_device(calls, "sweep-and-prune", at_once));
    core.add(unit, {});
    (void)core.finish();
  }
  EXPECT_EQ(calls, 0);
}

TEST(HybridOpens, TheDestructorWaitsForIt) {
  bool is_over = false;
  {
    Core<Aabb> core(make_hybrid(
        make_algorithm({.algorithm = "oracle"}),
        [&]() -> AlgorithmPointer {
          std::this_thread::sleep_for(milliseconds(50));
          is_over = true;
          return nullptr;
        },
        slow_update));
    update_many(core, 100);
  }
  EXPECT_TRUE(is_over);
}

}  // namespace
}  // namespace broadcl::test
