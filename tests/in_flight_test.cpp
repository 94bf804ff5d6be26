#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "twins.hpp"
#include "warped.hpp"

/// begin() and finish(), and calls in between.
namespace broadcl::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallOneInFlightMayBeMovedAndDestroyed) {
  BroadPhase one(config());
  for (int k = 0; k < 20; ++k) one.add(unit);
  {
    BroadPhase other(config());
    for (int k = 0; k < 20; ++k) other.add(unit);
    other.begin();
  }
  one.begin();
  BroadPhase moved = std::move(one);
  moved.remove(19);
  EXPECT_TRUE(same(moved.finish(), all_pairs(20), {}));
  EXPECT_EQ(moved.update().removed.size(), 19U);
}

/// Thousands of boxes are added while a few are searched; and pairs that this search finds end.
TEST_P(EachAlgorithm, MemoryGrowsForWhatIsAddedInFlight) {
  const std::uint32_t n = is_slow() ? 1000 : 5000;
  Twins twins(config());
  for (int k = 0; k < 30; ++k) twins.add(unit);
  twins.begin();
  for (std::uint32_t k = 0; k < n; ++k) twins.add(apart(k / 2), {.body = k / 8});
  twins.set_filter(7, {.world = 1});
  twins.remove(8);
  for (std::uint32_t id = 20; id < 30; ++id) twins.move(id, apart(id));
  ASSERT_TRUE(twins.agree());
  twins.move(9, apart(9));
  twins.begin();
  for (std::uint32_t id = 30; id < n + 30; ++id) twins.remove(id);
  ASSERT_TRUE(twins.agree());
  twins.begin();
  EXPECT_EQ(twins.add(unit), 8U);
  ASSERT_TRUE(twins.agree());
}

/// @returns Whether boxes that were set during an update are read about as fast as others.
template <class Subject>
bool are_read_at_once() {
  constexpr std::uint32_t n = 3000;
  Subject broad_phase(Config{.algorithm = "sweep-and-prune", .threads = 1});
  std::vector<std::uint32_t> ids;
  for (std::uint32_t k = 0; k < n; ++k) ids.push_back(broad_phase.add(apart(k), Filter()));
  const auto work_of_reads = [&] {
    std::clock_t least = std::numeric_limits<std::clock_t>::max();
    for (int time = 0; time < 5; ++time) {
      const std::clock_t start = std::clock();
      for (const std::uint32_t id : ids) EXPECT_EQ(broad_phase.box(id).lower[0], apart(id + 1).lower[0]);
      least = std::min(least, std::clock() - start);
    }
    return static_cast<double>(least);
  };
  broad_phase.begin();
  for (const std::uint32_t id : ids) broad_phase.move(id, apart(id));
  for (const std::uint32_t id : ids) broad_phase.move(id, apart(id + 1));
  const double in_flight = work_of_reads();
  (void)broad_phase.finish();
  return in_flight < 3 * work_of_reads();
}

NOT_IN(sanitizers, "measures time");
TEST(InFlight, BoxesThatWereSetAreReadAtOnce) {
  EXPECT_TRUE(are_read_at_once<BroadPhase>());
  EXPECT_TRUE(are_read_at_once<Warped<BroadPhase64>>());
}

/// More pairs than the device has memory for: finish() reports this error. Everything that was done before
/// and in flight is still there, and the next update has the right changes.
TEST(Long, ExhaustedMemoryInFlightLosesNothing) {
  constexpr std::uint32_t few = 20;
  BroadPhase broad_phase({.algorithm = "brute-force"});
  const std::uint64_t limit = broad_phase.device()->max_allocation;
  // The list of pairs alone takes 8 bytes per pair, and almost all boxes overlap.
  const auto n = few + 3 + static_cast<std::uint32_t>(std::sqrt(static_cast<double>(limit) / 4));
  if (n > 50'000) GTEST_SKIP() << "the device allocates more than 10 GB at once";
  if (broad_phase.device()->platform_name.find("rusticl") != std::string::npos)
    GTEST_SKIP() << "takes minutes";
  for (std::uint32_t k = 0; k < few; ++k) broad_phase.add(apart(k / 2));
  EXPECT_EQ(broad_phase.update().added.size(), few / 2);
  const Pairs before = broad_phase.pairs();

  for (std::uint32_t id = few; id < n; ++id) broad_phase.add({{-9, 0, 0}, {-8, 1, 1}});
  broad_phase.begin();
  broad_phase.move(1, apart(1));
  const std::uint32_t late = broad_phase.add(apart(2));
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(100'000));  // more than fit
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.remove(late + n - k);
  EXPECT_THAT(error_of([&] { (void)broad_phase.finish(); }),
              AllOf(HasSubstr(std::to_string(limit)), HasSubstr("fewer boxes")));
  EXPECT_EQ(broad_phase.pairs(), before);
  EXPECT_EQ(broad_phase.size(), n + 1);

  // Changes from now on come after those made in flight.
  broad_phase.move(1, apart(3));
  broad_phase.move(late, apart(4));
  for (std::uint32_t id = few; id < n; ++id) broad_phase.remove(id);
  EXPECT_TRUE(same(broad_phase.update(), Pairs{{1, 6}, {1, 7}, {8, late}, {9, late}}, Pairs{{0, 1}}));
}

}  // namespace
}  // namespace broadcl::test
