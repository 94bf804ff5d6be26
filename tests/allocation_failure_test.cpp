#include <algorithm>
#include <cstdint>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "core/core.hpp"
#include "each_algorithm.hpp"
#include "engines/hybrid.hpp"
#include "failing_allocations.hpp"
#include "opencl/error.hpp"
#include "opencl/kernel_source.hpp"
#include "pretender.hpp"
#include "short_life.hpp"
#include "test_name.hpp"
#include "trouble.hpp"
#include "twins.hpp"
#include "warped.hpp"

/// Failed allocations of host memory: every call does all of its work or none.
namespace broadcl::test {
namespace {

using AllocationTrouble = Trouble<FailingAllocations, FailingAllocations::allocations>;

INSTANTIATE_TEST_SUITE_P(Table, EachAlgorithm, ::testing::ValuesIn(algorithms().begin(), algorithms().end()),
                         named_by_parameter);

/// Allocations start to fail at a different one in each life.
constexpr auto expect_host_lives = expect_short_lives<AllocationTrouble>;
constexpr auto expect_lives_on_device = expect_device_lives<AllocationTrouble>;

/// Each allocation with sweep-and-prune, some on a device, where a life takes longer, and with the oracle,
/// most of whose allocations are not its own.
long most_lives(const AlgorithmInfo& algorithm) {
  return algorithm.name == "sweep-and-prune" ? AllocationTrouble::for_good : 25;
}

TEST_P(EachAlgorithm, AnAllocationThatFailsIsMadeGood) {
  expect_host_lives(config(), 1, most_lives(GetParam()), false);
}

TEST_P(EachAlgorithm, AnAllocationThatFailsInDoublePrecisionIsMadeGood) {
  constexpr auto expect_lives = expect_short_lives<AllocationTrouble, NoWatch, Warped<BroadPhase64>>;
  expect_lives(config(), 1, most_lives(GetParam()), false);
  constexpr auto expect_lives_in_towns =
      expect_short_lives<AllocationTrouble, NoWatch, Warped<BroadPhase64>, 4>;
  expect_lives_in_towns(config(), 1, most_lives(GetParam()), false);
}

/// Calls a function until none of its allocations fails any more; after each failure, all is as before.
template <class Function>
void call_with_failures(BroadPhase64& broad_phase, const Function& function) {
  const Pairs pairs = broad_phase.pairs();
  const std::size_t size = broad_phase.size();
  const std::vector<double> reaches = broad_phase.reaches();
  const std::vector<Filter> filters = broad_phase.filters();
  for (long first = 0;; ++first) {
    try {
      const FailingAllocations failing(first, 1);
      return function();
    } catch (const std::bad_alloc&) {
    }
    EXPECT_TRUE(same("pairs", broad_phase.pairs(), pairs));
    ASSERT_EQ(broad_phase.size(), size);
    EXPECT_EQ(broad_phase.reaches(), reaches);
    EXPECT_EQ(broad_phase.filters(), filters);
  }
}

TEST(AllocationFailure, ReachesInDoublePrecision) {
  BroadPhase64 failing({.algorithm = "sweep-and-prune"});
  BroadPhase64 other({.algorithm = "oracle"});
  std::vector<Aabb64> boxes(300);
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const double x = 1e7 + 1.1 * static_cast<double>(k);
    boxes[k] = {{x, 0, 0}, {x, 0, 0}};
  }
  const auto call = [&](const auto& function) {
    call_with_failures(failing, [&] { function(failing); });
    function(other);
    EXPECT_TRUE(same("pairs", failing.pairs(), other.pairs()));
  };
  const std::vector<Filter> filters(1);
  const std::vector<double> reaches{0.55};
  const std::vector<double> longer{1.1};
  const std::vector<std::uint32_t> some{0, 3, 7, 299};
  const auto update = [](BroadPhase64& broad_phase) { (void)broad_phase.update(); };
  call([&](BroadPhase64& broad_phase) { broad_phase.add(boxes, filters); });
  call(update);
  call([&](BroadPhase64& broad_phase) { broad_phase.set_reach(some, longer); });
  call(update);
  const std::vector<Filter> of_some{{.body = 1}, {.body = 1}, {.mask = 0}, {.world = 3}};
  call([&](BroadPhase64& broad_phase) { broad_phase.set_filters(some, of_some); });
  EXPECT_EQ(failing.filters(), other.filters());
  call(update);
  EXPECT_GT(failing.pairs().size(), 0U);
  call([&](BroadPhase64& broad_phase) { broad_phase.add(boxes, filters, reaches); });
  call(update);
  boxes.resize(700, {{1e7, 0, 0}, {1e7, 0, 0}});
  call([&](BroadPhase64& broad_phase) { (void)broad_phase.update(boxes); });
  call([](BroadPhase64& broad_phase) { broad_phase.shrink(); });
  call(update);
}

/// Whatever a search has done with the new boxes when it failed, the next one has the old ones.
TEST_P(EachAlgorithm, AfterAnUpdateThatFailedTheOldBoxesMove) {
  BroadPhase broad_phase(config());
  std::vector<Aabb> boxes = row(400, 0.7F);
  (void)broad_phase.update(boxes);
  for (const std::size_t n : {100U, 700U}) {
    const std::vector<Aabb> others = row(n, 0.3F);
    for (long first = 0;; ++first) {
      SCOPED_TRACE("allocation " + std::to_string(first));
      bool has_failed = false;
      try {
        const FailingAllocations one_fails(first, 1);
        (void)broad_phase.update(others);
      } catch (const Error&) {
        has_failed = true;
      } catch (const std::bad_alloc&) {
        has_failed = true;
      }
      if (!has_failed) break;
      boxes[7] = in_row(static_cast<std::size_t>(first % 90));
      broad_phase.move(7, boxes[7]);
      (void)broad_phase.update();
      ASSERT_TRUE(same("pairs", broad_phase.pairs(), overlapping_pairs(boxes, {}, {.algorithm = "oracle"})));
    }
    (void)broad_phase.update(boxes);
  }
}

/// Whatever a query has read when it fails, later ones and the next update find all.
TEST_P(EachAlgorithm, AQueryThatFailsHasChangedNothing) {
  std::vector<Aabb> boxes = row(700, 0.7F);
  const std::vector<Aabb> queries = row(600, 0.4F);
  BroadPhase broad_phase(config());
  (void)broad_phase.add(BoxView(boxes));
  for (long first = 0;; ++first) {
    SCOPED_TRACE("allocation " + std::to_string(first));
    (void)broad_phase.update();
    boxes[7] = in_row(static_cast<std::size_t>(first % 90));
    broad_phase.move(7, boxes[7]);
    bool has_failed = false;
    try {
      const FailingAllocations one_fails(first, 1);
      (void)broad_phase.overlapping(BoxView(queries));
    } catch (const std::bad_alloc&) {
      has_failed = true;
    }
    ASSERT_EQ(broad_phase.overlapping(BoxView(queries)).ids,
              overlapping(BoxView(boxes), BoxView(queries)).ids);
    if (!has_failed) break;
  }
  (void)broad_phase.update();
  ASSERT_TRUE(same("pairs", broad_phase.pairs(), overlapping_pairs(boxes, {}, {.algorithm = "oracle"})));
}

TEST_P(EachAlgorithm, AllocationsThatFailFromOneOnAreMadeGood) {
  expect_host_lives(config(), AllocationTrouble::for_good, 12, true);
}

TEST(AllocationFailure, OfADeviceBroadPhaseIsMadeGood) {
  for (const std::string algorithm : {"brute-force", "tiles"}) {
    SCOPED_TRACE(algorithm);
    expect_lives_on_device(algorithm, 1, 12);
    expect_lives_on_device(algorithm, AllocationTrouble::for_good, 8);
  }
}

/// Once one object has moved often enough, the hybrid switches from the host to its supposed device.
/// @tparam Subject Core, or one with the same functions.
template <class Subject>
void expect_hybrid_lives() {
  for (const long count : {1L, AllocationTrouble::for_good}) {
    int changed_over = 0;
    expect_right_lives(200, [&](long first) -> std::optional<long> {
      const Pretender::Orders orders{.expected_seconds = 0, .expected_for_all = 7e-6};
      Twins<Subject, AllocationTrouble> twins(
          std::in_place, AllocationTrouble(first, count), first % 4 < 2,
          make_hybrid(
              make_algorithm({.algorithm = "oracle"}),
              [&orders] { return std::make_unique<Pretender>(orders); }, 0));
      if (!live(twins, {.updates = 1000})) return std::nullopt;
      if (orders.updates > 0) ++changed_over;
      return twins.trouble().points();
    });
    EXPECT_GT(changed_over, 0);
  }
}

TEST(AllocationFailure, OfAHybridIsMadeGood) {
  expect_hybrid_lives<Core<Aabb>>();
}

TEST(AllocationFailure, OfAHybridInDoublePrecisionIsMadeGood) {
  expect_hybrid_lives<Warped<Core<Aabb64>>>();
}

/// Every allocation, including those for kernels that are built in the middle of a life.
class LongFailure : public EachAlgorithm {};
INSTANTIATE_TEST_SUITE_P(Long, LongFailure, ::testing::ValuesIn(algorithms().begin(), algorithms().end()),
                         named_by_parameter);
TEST_P(LongFailure, OfEveryAllocationIsMadeGood) {
  for (const auto& [count, most] :
       {std::pair{1L, AllocationTrouble::for_good}, {AllocationTrouble::for_good, 200L}}) {
    expect_host_lives(config(), count, most, true);
    expect_short_lives<AllocationTrouble, NoWatch, Warped<BroadPhase64>>(config(), count, most, true);
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
  (void)overlapping_pairs(std::vector<Aabb>(), {}, config());  // opens the device
  {
    const FailingAllocations none_fails(0, 0);
    (void)overlapping_pairs(std::vector<Aabb>(), {}, config());
    at_start = FailingAllocations::allocations();
  }
  expect_errors_until_it_succeeds(std::max(0L, at_start - 10), at_start + 50, [&] {
    const Pairs pairs = overlapping_pairs(boxes, {}, config());
    const FailingAllocations::Pause pause;
    EXPECT_TRUE(same("pairs", pairs, expected));
  });
}

}  // namespace
}  // namespace broadcl::test
