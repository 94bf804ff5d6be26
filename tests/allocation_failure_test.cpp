#include <algorithm>
#include <cstdint>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "core/core.hpp"
#include "device_life.hpp"
#include "each_algorithm.hpp"
#include "engines/hybrid.hpp"
#include "failing_allocations.hpp"
#include "opencl/error.hpp"
#include "opencl/kernel_source.hpp"
#include "pretender.hpp"
#include "short_life.hpp"
#include "test_name.hpp"
#include "trouble.hpp"

/// Failed allocations of host memory: every call does all of its work or none.
namespace broadcl::test {
namespace {

using AllocationTrouble = Trouble<FailingAllocations, FailingAllocations::allocations>;

INSTANTIATE_TEST_SUITE_P(Table, EachAlgorithm, ::testing::ValuesIn(algorithms().begin(), algorithms().end()),
                         named_by_parameter);

/// Runs several lives; in each, the failures start at a different allocation.
/// @param count How many allocations fail.
void expect_short_lives(const BroadPhase::Config& config, long count, bool worlds, long most) {
  expect_right_lives(most, [&](long first) -> std::optional<long> {
    ShortLife life(config, AllocationTrouble(first, count), {.looks = first % 4 < 2, .worlds = worlds});
    if (!life.live()) return std::nullopt;
    return life.trouble().points();
  });
}

TEST_P(EachAlgorithm, AnAllocationThatFailsIsMadeGood) {
  expect_short_lives(config(), 1, false, 25);
}

TEST_P(EachAlgorithm, AllocationsThatFailFromOneOnAreMadeGood) {
  expect_short_lives(config(), AllocationTrouble::for_good, true, 12);
}

void expect_device_lives(const std::string& algorithm, long count, long most) {
  const CallersQueue queue;
  expect_right_lives(most, [&](long first) -> std::optional<long> {
    DeviceLife life(queue, {.algorithm = algorithm}, AllocationTrouble(first, count),
                    {.looks = first % 4 < 2});
    if (!life.live()) return std::nullopt;
    return life.trouble().points();
  });
}

TEST(AllocationFailure, OfADeviceBroadPhaseIsMadeGood) {
  for (const std::string algorithm : {"brute-force", "tiles"}) {
    SCOPED_TRACE(algorithm);
    expect_device_lives(algorithm, 1, 12);
    expect_device_lives(algorithm, AllocationTrouble::for_good, 8);
  }
}

/// Once one object has moved often enough, the hybrid switches from the host to its supposed device.
TEST(AllocationFailure, OfAHybridIsMadeGood) {
  for (const long count : {1L, AllocationTrouble::for_good}) {
    int changed_over = 0;
    expect_right_lives(200, [&](long first) -> std::optional<long> {
      const Pretender::Orders orders{.expected_seconds = 0, .expected_for_all = 7e-6};
      ShortLife<AllocationTrouble, Core> life(
          make_hybrid(
              make_algorithm({.algorithm = "oracle"}),
              [&orders] { return std::make_unique<Pretender>(orders); }, 0),
          AllocationTrouble(first, count), {.looks = first % 4 < 2, .worlds = true, .updates = 1000});
      if (!life.live()) return std::nullopt;
      if (orders.updates > 0) ++changed_over;
      return life.trouble().points();
    });
    EXPECT_GT(changed_over, 0);
  }
}

/// Every allocation, including those for kernels that are built in the middle of a life.
class LongFailure : public EachAlgorithm {};
INSTANTIATE_TEST_SUITE_P(Long, LongFailure, ::testing::ValuesIn(algorithms().begin(), algorithms().end()),
                         named_by_parameter);
TEST_P(LongFailure, OfEveryAllocationIsMadeGood) {
  for (const long count : {1L, AllocationTrouble::for_good}) {
    expect_short_lives(config(), count, true, AllocationTrouble::for_good);
  }
}

/// Calls a function until it does all of its work; in each call, one allocation fails.
/// @param first The allocation that fails in the first call.
/// @param all Up to this one, every allocation fails in turn; then every 107th.
template <class Function>
void expect_errors_until_it_succeeds(long first, long all, const Function& function) {
  long errors = 0;
  for (bool is_done = false; !is_done && !::testing::Test::HasFailure(); first += first < all ? 1 : 107) {
    SCOPED_TRACE("allocation " + std::to_string(first));
    try {
      const FailingAllocations one_fails(first, 1);
      function();
      is_done = FailingAllocations::allocations() <= first;
    } catch (const Error&) {
      ++errors;
    } catch (const std::bad_alloc&) {
      ++errors;
    } catch (...) {
      ADD_FAILURE() << "another exception escapes";
    }
  }
  EXPECT_GT(errors, 1);
}

TEST(AllocationFailure, KernelSourcesAreWholeOrAnError) {
  const std::string whole = opencl::kernel_source("tiles.cl");
  expect_errors_until_it_succeeds(0, 10'000, [&] {
    const std::string source = opencl::kernel_source("tiles.cl");
    const FailingAllocations::Pause pause;
    EXPECT_EQ(source, whole);
  });
}

/// Most allocations are for the sources of kernels, and these are all alike.
TEST_P(EachAlgorithm, ConstructorsThrowOnlyErrorsAndBadAlloc) {
  expect_errors_until_it_succeeds(0, 10, [] {
    opencl::forget_opened_devices();
    BroadPhase broad_phase(config());
  });
}

TEST_P(EachAlgorithm, AllPairsAtOnceAreRightOrAnError) {
  const Pairs expected = all_pairs(200);
  const std::vector<Aabb> boxes(200, unit);
  long at_start = 0;
  (void)overlapping_pairs(std::vector<Aabb>(), config());  // opens the device
  {
    const FailingAllocations none_fails(0, 0);
    (void)overlapping_pairs(std::vector<Aabb>(), config());
    at_start = FailingAllocations::allocations();
  }
  expect_errors_until_it_succeeds(std::max(0L, at_start - 10), at_start + 50, [&] {
    const Pairs pairs = overlapping_pairs(boxes, config());
    const FailingAllocations::Pause pause;
    EXPECT_TRUE(same("pairs", pairs, expected));
  });
}

}  // namespace
}  // namespace broadcl::test
