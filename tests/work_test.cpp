#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <functional>
#include <numeric>
#include <span>
#include <vector>

#include <gtest/gtest.h>

#include "base/packed_box.hpp"
#include "boxes.hpp"
#include "callers_queue.hpp"
#include "each_algorithm.hpp"
#include "engines/device_objects.hpp"
#include "engines/engine.hpp"
#include "failing_opencl.hpp"
#include "scenes/generators.hpp"
#include "scenes/random.hpp"

/// How much work an update is: by the kernels that it launches, the tests that kernels count, and processor
/// time on the host.
namespace broadcl::test {
namespace {

/// If few boxes moved, these are applied to the boxes of the last update; if many, all are uploaded.
TEST(BruteForce, AppliesIfFewMoved) {
  BroadPhase broad_phase({.algorithm = "brute-force"});
  for (std::uint32_t k = 0; k < 200; ++k) broad_phase.add(apart(k / 2));
  EXPECT_EQ(broad_phase.update().added.size(), 100U);
  for (const std::uint32_t moved : {1U, 50U, 51U}) {
    for (std::uint32_t id = 0; id < moved; ++id) broad_phase.move(id, apart(id / 2 + 1000 * moved));
    const long before = launches_of("apply_changes");
    (void)broad_phase.update();
    EXPECT_EQ(launches_of("apply_changes") - before, moved <= 50 ? 1 : 0) << moved;
  }
}

/// The number of frames in which boxes are sorted again, if a few move in each.
/// @param leap Whether each box jumps to the position of another one; otherwise it moves by a tenth of its
/// edge.
int count_sorts(bool leap) {
  constexpr std::uint32_t n = 4000;
  constexpr std::uint32_t moving = 40;
  const scenes::MovingBoxes scene(n, scenes::MovingBoxes::Sizes::uniform);
  std::vector<Aabb> boxes(scene.boxes().begin(), scene.boxes().end());
  BroadPhase broad_phase({.algorithm = "tiles"});
  for (const Aabb& box : boxes) broad_phase.add(box);
  (void)broad_phase.update();
  int sorts = 0;
  for (std::uint32_t frame = 0; frame < 200; ++frame) {
    for (std::uint32_t k = 0; k < moving; ++k) {
      const std::uint32_t id = (frame * moving + k) % n;
      if (leap) {
        boxes[id] = scene.boxes()[(id * 977 + frame) % n];
      } else {
        boxes[id].lower[0] += scene.edge() / 10;
        boxes[id].upper[0] += scene.edge() / 10;
      }
      broad_phase.move(id, boxes[id]);
    }
    const long before = launches_of("tiles_keys");
    (void)broad_phase.update();
    sorts += launches_of("tiles_keys") > before ? 1 : 0;
  }
  return sorts;
}

/// Boxes that leap are soon far from their neighbours in the order, so they are sorted again long before all
/// have leapt. If they only drift, the order may stay.
TEST(Tiles, BoxesAreSortedAgainSoonerIfTheyLeap) {
  const int drifting = count_sorts(false);
  const int leaping = count_sorts(true);
  EXPECT_LE(drifting, 8);
  EXPECT_GE(leaping, 3);
  EXPECT_GT(leaping, drifting);
}

/// Those that are left would be a few per tile.
TEST(Tiles, BoxesAreSortedAgainOnceMostAreGone) {
  constexpr std::uint32_t n = 4000;
  const scenes::MovingBoxes scene(n, scenes::MovingBoxes::Sizes::uniform);
  BroadPhase broad_phase({.algorithm = "tiles"});
  for (const Aabb& box : scene.boxes()) broad_phase.add(box);
  (void)broad_phase.update();
  const auto sorts_after_removing = [&](std::uint32_t first, std::uint32_t end) {
    for (std::uint32_t k = first; k < end; ++k) broad_phase.remove(k);
    const long before = launches_of("tiles_keys");
    (void)broad_phase.update();
    return launches_of("tiles_keys") - before;
  };
  EXPECT_EQ(sorts_after_removing(0, n / 4), 0);
  EXPECT_EQ(sorts_after_removing(n / 4, n / 10 * 9), 1);
}

/// Of one thread.
class HostWork : public ::testing::Test {
 protected:
  /// Processor time of an update, which other processes do not prolong.
  double work_of_update() {
    const std::clock_t start = std::clock();
    (void)broad_phase_.update();
    return static_cast<double>(std::clock() - start);
  }
  double work_of(std::span<const Aabb> boxes) {
    std::ranges::copy(boxes, broad_phase_.map(boxes.size()).begin());
    return work_of_update();
  }

  static constexpr std::uint32_t n = 200'000;
  const scenes::MovingBoxes scene_{n, scenes::MovingBoxes::Sizes::uniform};
  BroadPhase broad_phase_{{.algorithm = "sweep-and-prune", .threads = 1}};
};
SUITE_NOT_IN(HostWork, sanitizers, "which slow down one part more than another");

/// If all boxes leap at once, the order is useless; the search must notice this before it has tested all
/// pairs.
TEST_F(HostWork, IsThatOfASortIfAllBoxesLeap) {
  std::vector<Aabb> boxes(scene_.boxes().begin(), scene_.boxes().end());
  const double first = work_of(boxes);
  const std::size_t pairs = broad_phase_.pairs().size();
  ASSERT_GT(pairs, n / 2);
  scenes::Random random(1);
  for (int k = 0; k < 3; ++k) {
    random.shuffle(std::span(boxes));
    EXPECT_LT(work_of(boxes), 8 * first);
    EXPECT_EQ(broad_phase_.pairs().size(), pairs);
  }
}

/// Updates must not visit the tiles of objects that are gone.
TEST_F(HostWork, IsThatOfTheObjectsThatAreLeft) {
  constexpr std::uint32_t left = 100;
  const double of_all = std::min(work_of(scene_.boxes()), work_of(scene_.boxes()));
  (void)work_of(scene_.boxes().first(left));
  double of_the_rest = 0;
  for (std::size_t k = 1; k <= 200; ++k) of_the_rest += work_of(scene_.boxes().subspan(k, left));
  EXPECT_LT(of_the_rest, of_all);
}

/// After a frame of two sets, one without worlds and sets has an order of its own.
TEST_F(HostWork, IsThatOfTheBoxThatMovesAlsoAfterTwoSets) {
  for (std::uint32_t k = 0; k < n; ++k) {
    broad_phase_.add(scene_.boxes()[k], k % 2 == 0 ? Filter::first_set : Filter::second_set);
  }
  (void)broad_phase_.update();
  for (std::uint32_t k = 0; k < n; ++k) broad_phase_.set_filter(k, {});
  const double of_all = work_of_update();
  double of_one = of_all;
  for (int k = 0; k < 5; ++k) {
    broad_phase_.move(0, scene_.boxes()[static_cast<std::size_t>(k) + 1]);
    of_one = std::min(of_one, work_of_update());
  }
  EXPECT_LT(of_one, of_all / 10);
}

/// All boxes leap to each other's positions. In the old order, the search would test all pairs: it is given
/// up and repeated in a new order. The pairs are those of the positions, whichever boxes are there.
void expect_leaps_to_be_sorted_at_once(const std::function<Pairs(const std::vector<Aabb>&)>& update) {
  constexpr std::uint32_t n = 20'000;
  const scenes::MovingBoxes scene(n, scenes::MovingBoxes::Sizes::uniform);
  std::vector<std::uint32_t> places(n);
  std::iota(places.begin(), places.end(), 0U);
  const auto frame = [&] {
    std::vector<Aabb> boxes(n);
    std::ranges::transform(places, boxes.begin(), [&](std::uint32_t place) { return scene.boxes()[place]; });
    Pairs pairs = update(boxes);
    for (Pair& pair : pairs) {
      const std::uint32_t s = places[pair.a];
      const std::uint32_t t = places[pair.b];
      pair = {std::min(s, t), std::max(s, t)};
    }
    std::ranges::sort(pairs);
    return pairs;
  };
  const Pairs expected = frame();
  ASSERT_GT(expected.size(), n / 2);
  scenes::Random random(1);
  for (int k = 0; k < 3; ++k) {
    const long before = launches_of("tiles_fill");
    (void)frame();
    const long at_rest = launches_of("tiles_fill");
    EXPECT_GT(at_rest, before);
    random.shuffle(std::span(places));
    EXPECT_TRUE(same("pairs", frame(), expected));
    const int times = k < 2 ? 2 : 1;  // after two leaps, the third is expected
    EXPECT_EQ(launches_of("tiles_fill") - at_rest, times * (at_rest - before))
        << "how often the tree is built";
  }
}

ALSO_IN(gpu_profile | rusticl);
TEST(Tiles, BoxesThatAllLeapAreSortedAtOnce) {
  BroadPhase broad_phase({.algorithm = "tiles"});
  expect_leaps_to_be_sorted_at_once([&](const std::vector<Aabb>& boxes) {
    std::ranges::copy(boxes, broad_phase.map(boxes.size()).begin());
    (void)broad_phase.update();
    return broad_phase.pairs();
  });
}

/// The first search gathers the boxes.
ALSO_IN(gpu_profile);
TEST(Tiles, BoxesInABufferThatAllLeapAreSortedAtOnce) {
  const CallersQueue queue;
  DeviceBroadPhase broad_phase(queue(), {.algorithm = "tiles"});
  expect_leaps_to_be_sorted_at_once([&](const std::vector<Aabb>& boxes) {
    const cl::Buffer buffer = queue.buffer_of(boxes);
    (void)broad_phase.update({.buffer = buffer(), .count = boxes.size()});
    return queue.read(broad_phase.pairs());
  });
}

/// Frames of `tiles`, of which the device counts the work.
class TilesFrames {
 public:
  static constexpr cl_uint n = 8192;

  TilesFrames() { objects_.reserve(n, false); }

  [[nodiscard]] std::span<Aabb> boxes() const { return objects_.boxes().first(n); }

  /// @param changed Slots; all if there are none.
  PairDelta::Counts play(std::span<const std::uint32_t> changed = {}) {
    engine_.prepare();
    engine_.begin(objects_.upload({.boxes = boxes(), .changed = {.all = changed.empty(), .slots = changed}}));
    engine_.search();
    const PairDelta::Counts counts = engine_.finish();
    objects_.commit();
    return counts;
  }

 private:
  opencl::Context context_{select_device(), false};
  opencl::Profiler profiler_{false};
  Engine engine_{context_, profiler_, make_tiles, Order::Target::host};
  DeviceObjects objects_{context_, profiler_, engine_.frames()};
};

/// The work of finding the pairs of equal boxes among far more empty ones.
std::size_t work_of_large_boxes(cl_uint distance) {
  constexpr cl_uint large = 64;
  TilesFrames frames;
  std::ranges::fill(frames.boxes(), packed_empty());
  for (std::size_t k = 0; k < large; ++k) frames.boxes()[k * distance] = unit;
  const PairDelta::Counts counts = frames.play();
  EXPECT_EQ(counts.added, large * (large - 1) / 2);
  return counts.work;
}

/// Large boxes fill a few tiles, whatever else there is: every tile visits those. So where they are among the
/// others changes nothing. (How much work it is depends on how many work-groups share a tile.)
ALSO_IN(gpu_profile);
TEST(Tiles, LargeBoxesDoNotShareTilesWithEmptyOnes) {
  EXPECT_EQ(work_of_large_boxes(128), work_of_large_boxes(1));
}

ALSO_IN(gpu_profile);
TEST(Tiles, FewChangesTakeLittleWork) {
  TilesFrames frames;
  // Each overlaps a hundred others: work-groups that find nothing count, too, as many as there are units.
  const auto in_row = [](std::uint32_t k) {
    const float x = 0.02F * static_cast<float>(k);
    return Aabb{{x, 0, 0}, {x + 1, 1, 1}};
  };
  for (std::uint32_t k = 0; k < TilesFrames::n; ++k) frames.boxes()[k] = in_row(k);
  const std::size_t of_all = frames.play().work;
  frames.boxes()[7] = in_row(4 * TilesFrames::n);
  const PairDelta::Counts counts = frames.play(std::array{7U, 5000U});
  EXPECT_EQ(counts.added, 0U);
  EXPECT_GT(counts.work, 0U);
  EXPECT_LT(2 * counts.work, of_all);
}

}  // namespace
}  // namespace broadcl::test
