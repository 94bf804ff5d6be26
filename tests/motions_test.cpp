// Objects that move in every way that the table of motions has: each algorithm reports what the oracle
// reports.
#include "scenes/motions.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "each_algorithm.hpp"

namespace broadcl::test {
namespace {

using scenes::Motion;
using scenes::MotionFrame;
using scenes::MotionInfo;

/// How many objects are played, and for how long.
struct Extent {
  std::uint32_t objects;
  int frames;
};

/// Plays a scene to an object and to the oracle.
template <class Tested = BroadPhase>
void expect_oracle_in(Motion motion, const BroadPhase::Config& config, int frames) {
  Tested tested(config);
  BroadPhase oracle({.algorithm = "oracle"});
  for (int frame = 0; frame < frames; ++frame) {
    const MotionFrame calls = motion.next();
    const Delta expected = calls.play(oracle);
    ASSERT_TRUE(same(calls.play(tested), expected.added, expected.removed)) << "frame " << frame;
  }
  ASSERT_TRUE(same("pairs", tested.pairs(), oracle.pairs()));
  ASSERT_FALSE(oracle.pairs().empty());
}

template <class Tested = BroadPhase>
void expect_oracle_in_each(const BroadPhase::Config& config, Extent extent) {
  for (const MotionInfo& info : scenes::motions()) {
    SCOPED_TRACE(std::string(info.name) + ", " + std::to_string(config.threads) + " threads");
    const bool all_pair = info.name == "one-place";
    const std::uint32_t objects = all_pair ? std::min(extent.objects, 300U) : extent.objects;
    expect_oracle_in<Tested>(Motion(info, objects), config, extent.frames);
  }
}

NOT_IN(gpu_profile | rusticl, "takes a minute there");
TEST_P(EachAlgorithm, FollowsEachMotion) {
  const Extent extent = GetParam().on_device ? Extent{200, 8} : Extent{400, 20};
  expect_oracle_in_each(config(), is_slow() ? Extent{100, 4} : extent);
}

TEST_P(EachAlgorithm, FollowsEachMotionOfObjectsWithFilters) {
  const Extent extent = GetParam().on_device || is_slow() ? Extent{100, 4} : Extent{300, 12};
  for (const MotionInfo& info : scenes::motions()) {
    SCOPED_TRACE(info.name);
    Motion motion(info, extent.objects);
    for (std::uint32_t id = 0; id < motion.count(); ++id) {
      motion.filters[id] = {.group = 1U << id % 3,
                            .mask = id % 5 == 0 ? 3U : 7U,
                            .body = id / 4,
                            .world = id % 7 == 0 ? Filter::all_worlds : id / 50};
    }
    expect_oracle_in(std::move(motion), config(), extent.frames);
  }
}

TEST(Motions, AreFollowedByOneThreadAndBySeveral) {
  for (const std::size_t threads : {1U, 3U}) {
    expect_oracle_in_each({.algorithm = "sweep-and-prune", .threads = threads},
                          is_sanitized ? Extent{300, 6} : Extent{1100, 8});
  }
}

TEST(Motions, AreFollowedInDoublePrecision) {
  expect_oracle_in_each<BroadPhase64>({.algorithm = "sweep-and-prune"}, {200, 12});
}

TEST(LongMotions, AreFollowedForManyFrames) {
  for (const std::size_t threads : {1U, 3U}) {
    expect_oracle_in_each({.algorithm = "sweep-and-prune", .threads = threads}, {2000, 150});
  }
}

}  // namespace
}  // namespace broadcl::test
