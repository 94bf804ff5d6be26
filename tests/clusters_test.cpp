// Boxes in clusters far apart, in double precision: each algorithm reports what follows from the definition.
#include "scenes/clusters.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase64.hpp>

#include "boxes64.hpp"
#include "each_algorithm.hpp"
#include "exact.hpp"

namespace broadcl::test {
namespace {

using scenes::Clusters;
using scenes::ClustersInfo;

class RandomNumbers {
 public:
  explicit RandomNumbers(std::uint32_t seed) : engine_(seed) {}

  std::uint32_t below(std::size_t n) { return static_cast<std::uint32_t>(engine_() % n); }
  template <class T, std::size_t n>
  T pick(const std::array<T, n>& values) {
    return values[below(n)];
  }

 private:
  std::mt19937 engine_;
};

ClustersInfo random_info(RandomNumbers& random, std::uint32_t boxes) {
  const double edge = random.pick(std::array{1e-3, 0.1, 1.0});
  const double reach = random.pick(std::array{50 * edge, 6.4e6, 6.4e6, 1e9});
  return {.name = "random",
          .boxes = boxes,
          .clusters = random.pick(std::array{1U, 2U, 3U, 8U, 100U, boxes / 10}),
          .edge = edge,
          .reach = reach,
          .axes = random.pick(std::array{1, 3, 3}),
          .movers = random.pick(std::array{0U, 1U, 20U, boxes}),
          .overlaps = random.pick(std::array{4.0, 8.0, 16.0}),
          .flush = random.below(3) == 0,
          .planes = random.pick(std::array{0U, 0U, 1U, 3U}),
          .convoy = random.pick(std::array{0U, 40U, boxes / 4, boxes / 2}),
          .speed = random.pick(std::array{0.0, edge, reach / 10, reach}),
          .jumps_every = random.pick(std::array{0U, 0U, 3U}),
          .commuters = random.pick(std::array{0U, 0U, 5U, 100U}),
          .whole = random.below(4) == 0};
}

/// Moves a box so that it begins or ends at a bound of others, or an ulp beside.
void touch(Aabb64& box, std::size_t axis, double bound, RandomNumbers& random) {
  const double extent = box.upper[axis] - box.lower[axis];
  const double at = std::nextafter(bound, random.pick(std::array{-infinity64, bound, infinity64}));
  box.lower[axis] = at - random.pick(std::array{0.0, extent});
  box.upper[axis] = box.lower[axis] == at ? at + extent : at;
}

/// A bound beside which there is nothing on one side.
double beside_gap(const Boxes64& boxes, std::size_t axis, double gap, RandomNumbers& random) {
  std::vector<double> bounds;
  for (const Aabb64& box : boxes) bounds.insert(bounds.end(), {box.lower[axis], box.upper[axis]});
  std::ranges::sort(bounds);
  std::size_t k = random.below(bounds.size() - 1);
  while (k + 2 < bounds.size() && bounds[k + 1] - bounds[k] < gap) ++k;
  return bounds[k + random.below(2)];
}

std::vector<Filter> random_filters(std::size_t n, RandomNumbers& random) {
  const bool are_worlds = random.below(2) == 0;
  std::vector<Filter> filters(n);
  for (Filter& filter : filters) {
    if (are_worlds) filter.world = random.pick(std::array{0U, 1U, Filter::all_worlds});
    if (!are_worlds) filter = random.pick(std::array{Filter::first_set, Filter::second_set});
  }
  return filters;
}

/// Plays a scene in which now and then some boxes come to touch others or to a gap, and ids are recycled.
void play(const ClustersInfo& info, const Config& config, int frames, std::uint32_t seed) {
  SCOPED_TRACE(std::string(info.name) + ", " + std::to_string(info.clusters) + " clusters, seed " +
               std::to_string(seed));
  RandomNumbers random(seed);
  Clusters scene(info, seed);
  (void)scene.next();
  Boxes64 boxes(scene.far().begin(), scene.far().end());
  Exact exact(config, random.below(4));
  if (random.below(4) == 0) exact.set_filters(random_filters(boxes.size(), random));
  for (int frame = 0; frame < frames; ++frame) {
    exact.update(boxes, "clusters");
    const auto moves = scene.next().far;
    if (moves.whole) boxes = moves.boxes;
    for (std::size_t k = 0; k < moves.moved.size(); ++k) boxes[moves.moved[k]] = moves.boxes[k];
    const Pairs& pairs = exact.pairs();
    for (std::uint32_t k = random.pick(std::array{0U, 0U, 1U, 30U}); k > 0 && !pairs.empty(); --k) {
      const auto [a, b] = pairs[random.below(pairs.size())];
      const std::size_t axis = random.below(3);
      touch(boxes[b], axis, boxes[a].upper[axis], random);
    }
    for (std::uint32_t k = random.pick(std::array{0U, 0U, 5U}); k > 0; --k) {
      const std::size_t axis = random.below(3);
      touch(boxes[random.below(boxes.size())], axis, beside_gap(boxes, axis, 10 * info.edge, random), random);
    }
    for (std::uint32_t k = random.pick(std::array{0U, 0U, 2U}); k > 0; --k)
      exact.recycle(random.below(boxes.size()));
    if (::testing::Test::HasFailure()) return;
  }
  EXPECT_TRUE(same("pairs of one search", overlapping_pairs(boxes, {}, config), expected_pairs(boxes)));
}

void play_random(const Config& config, std::uint32_t scenes, std::uint32_t boxes, std::uint32_t first_seed) {
  for (std::uint32_t seed = first_seed; seed < first_seed + scenes && !::testing::Test::HasFailure();
       ++seed) {
    RandomNumbers random(seed);
    play(random_info(random, boxes), config, 8, seed);
  }
}

TEST_P(LongEachAlgorithm, FollowsRandomClusters) {
  play_random(config(), is_slow() ? 5 : GetParam().on_device ? 15 : 40, is_slow() ? 300 : 2'000, 1);
}

/// The scenes that are timed, with fewer boxes.
TEST(Clusters, AreFollowed) {
  for (ClustersInfo info : scenes::clusters()) {
    info.boxes = is_sanitized ? 1'000 : 2'000;
    play(info, {.algorithm = "sweep-and-prune", .threads = 3}, 6, 1);
  }
}

/// The same pairs are in single precision with the clusters side by side, or a scene would compare others.
TEST(Clusters, HaveTheSamePairsNearZero) {
  for (ClustersInfo info : scenes::clusters()) {
    if (info.flush || info.planes > 0) continue;
    SCOPED_TRACE(info.name);
    info.boxes = 3'000;
    Clusters scene(info);
    for (int frame = 0; frame < 15; ++frame) (void)scene.next();
    const std::size_t far = overlapping_pairs(scene.far()).size();
    EXPECT_NEAR(static_cast<double>(far), static_cast<double>(overlapping_pairs(scene.near()).size()),
                1e-3 * static_cast<double>(far));
    EXPECT_GT(far, 1'000U);
  }
}

TEST(LongClusters, AreFollowed) {
  for (const AlgorithmInfo& info : algorithms()) {
    play_random({.algorithm = std::string(info.name)}, 200, 3'000, std::random_device()());
  }
}

}  // namespace
}  // namespace broadcl::test
