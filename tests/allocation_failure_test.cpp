#include <algorithm>
#include <cstdint>
#include <new>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "device_life.hpp"
#include "each_algorithm.hpp"
#include "failing_allocations.hpp"
#include "short_life.hpp"
#include "trouble.hpp"

/// Memory of the host that cannot be had: every call does all of its work or none.
namespace broadcl::test {
namespace {

using AllocationTrouble = Trouble<FailingAllocations, FailingAllocations::allocations>;

INSTANTIATE_TEST_SUITE_P(Table, EachAlgorithm, ::testing::ValuesIn(algorithms().begin(), algorithms().end()),
                         [](const auto& test) {
                           std::string name(test.param.name);
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

/// Lives a life in which allocation 0 fails, one in which allocation `step` fails, and so on.
void expect_short_lives(const BroadPhase::Config& config, long count, bool worlds, long step) {
  int failures = 0;
  for (long first = 0, points = 1; first < points; first += step) {
    SCOPED_TRACE("allocation " + std::to_string(first) + (count == 1 ? "" : " and those after it"));
    ShortLife life(config, AllocationTrouble(first, count), {.looks = first % 2 == 0, .worlds = worlds});
    ASSERT_TRUE(life.live());
    points = life.trouble().points();
    failures += life.trouble().failures();
  }
  EXPECT_GT(failures, 10);
}

TEST_P(EachAlgorithm, EachAllocationThatFailsOnceIsMadeGood) {
  expect_short_lives(config(), 1, false, 1);
}

TEST_P(EachAlgorithm, EachAllocationFromWhichOnAllFailIsMadeGood) {
  expect_short_lives(config(), AllocationTrouble::for_good, false, 1);
}

/// Some algorithms build a kernel in between, which makes hundreds of allocations.
TEST_P(EachAlgorithm, AllocationsThatFailAreMadeGoodWithWorldsToo) {
  expect_short_lives(config(), 1, true, 5);
}

TEST(AllocationFailure, DeviceBroadPhaseIsRepeated) {
  const CallersQueue queue;
  for (const long count : {1L, AllocationTrouble::for_good}) {
    for (const std::string algorithm : {"brute-force", "tiles"}) {
      int failures = 0;
      for (long first = 0, points = 1; first < points; ++first) {
        SCOPED_TRACE(algorithm + ", allocation " + std::to_string(first) +
                     (count == 1 ? "" : " and those after it"));
        DeviceLife life(queue, {.algorithm = algorithm}, AllocationTrouble(first, count),
                        {.looks = first % 2 == 0});
        ASSERT_TRUE(life.live());
        points = life.trouble().points();
        failures += life.trouble().failures();
      }
      EXPECT_GT(failures, 3);
    }
  }
}

/// Calls a function, whose allocations fail one at a time, until it does all of its work.
template <class Function>
void expect_errors_until_it_succeeds(const Function& function) {
  long failures = 0;
  bool is_done = false;
  while (!is_done && !::testing::Test::HasFailure()) {
    long allocations = 0;
    try {
      const FailingAllocations one_fails(failures, 1);
      function();
      allocations = FailingAllocations::allocations();
      is_done = allocations <= failures;
    } catch (const Error&) {
    } catch (const std::bad_alloc&) {
    } catch (...) {
      ADD_FAILURE() << "allocation " << failures << " lets another exception escape";
    }
    ++failures;
  }
  EXPECT_GT(failures, 2);
}

TEST_P(EachAlgorithm, ConstructorsThrowOnlyErrorsAndBadAlloc) {
  expect_errors_until_it_succeeds([] { BroadPhase broad_phase(config()); });
}

TEST_P(EachAlgorithm, AllPairsAtOnceAreRightOrAnError) {
  std::vector<Aabb> boxes;
  for (std::uint32_t k = 0; k < 200; ++k) boxes.push_back(unit);
  const Pairs expected = all_pairs(200);
  expect_errors_until_it_succeeds([&] {
    const Pairs pairs = overlapping_pairs(boxes, config());
    const FailingAllocations::Pause pause;
    EXPECT_TRUE(same("pairs", pairs, expected));
  });
}

}  // namespace
}  // namespace broadcl::test
