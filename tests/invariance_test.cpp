#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/algorithm.hpp"
#include "algorithms/engine.hpp"
#include "each_algorithm.hpp"
#include "scenes/generators.hpp"
#include "scenes/random.hpp"

/// The pairs must not depend on ids, directions and units, nor on how an algorithm finds them.
namespace broadcl::test {
namespace {

using scenes::Random;

/// Boxes of whole numbers, some infinite, some empty: if they are scaled by a power of two, they stay exact
/// down to the smallest number.
std::vector<Aabb> whole_numbers(std::uint32_t n) {
  Random random(3);
  std::vector<Aabb> boxes(n);
  for (Aabb& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = static_cast<float>(random.index(200)) - 100;
      box.upper[axis] = box.lower[axis] + static_cast<float>(random.index(20));
      if (random.index(50) == 0) box.lower[axis] = -infinity;
      if (random.index(50) == 0) box.upper[axis] = infinity;
      if (random.index(50) == 0) std::swap(box.lower[axis], box.upper[axis]);
    }
  }
  return boxes;
}

std::vector<scenes::BoxScene> scenes_of(std::uint32_t n) {
  std::vector<scenes::BoxScene> all = scenes::box_scenes(n);
  all.push_back({.name = "whole-numbers", .boxes = whole_numbers(n)});
  return all;
}

/// Finds all pairs of boxes, each time with the same object.
class Finder {
 public:
  explicit Finder(const BroadPhase::Config& config) : broad_phase_(config) {}
  Pairs operator()(const std::vector<Aabb>& boxes) {
    std::ranges::copy(boxes, broad_phase_.map(boxes.size()).begin());
    (void)broad_phase_.update();
    return broad_phase_.pairs();
  }

 private:
  BroadPhase broad_phase_;
};

/// Each box changed by a function.
template <class Function>
std::vector<Aabb> changed(std::vector<Aabb> boxes, const Function& change) {
  for (Aabb& box : boxes) change(box);
  return boxes;
}

TEST_P(EachAlgorithm, IdsMayBePermuted) {
  const std::uint32_t n = is_slow() ? 100 : 400;
  Finder find(config());
  for (const scenes::BoxScene& scene : scenes_of(n)) {
    const auto size = static_cast<std::uint32_t>(scene.boxes.size());
    std::vector<std::uint32_t> id(size);
    std::iota(id.begin(), id.end(), 0);
    Random(9).shuffle(std::span(id));
    std::vector<Aabb> boxes(size);
    for (std::uint32_t k = 0; k < size; ++k) boxes[id[k]] = scene.boxes[k];
    Pairs expected = find(scene.boxes);
    for (Pair& pair : expected) pair = {std::min(id[pair.a], id[pair.b]), std::max(id[pair.a], id[pair.b])};
    std::sort(expected.begin(), expected.end());
    EXPECT_TRUE(same(scene.name, find(boxes), expected));
  }
}

TEST_P(EachAlgorithm, AxesMayBeMirroredAndExchanged) {
  const std::uint32_t n = is_slow() ? 100 : 400;
  Finder find(config());
  for (const scenes::BoxScene& scene : scenes_of(n)) {
    const Pairs expected = find(scene.boxes);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::vector<Aabb> mirrored = changed(scene.boxes, [&](Aabb& box) {
        const float lower = box.lower[axis];
        box.lower[axis] = -box.upper[axis];
        box.upper[axis] = -lower;
      });
      EXPECT_TRUE(same(scene.name, find(mirrored), expected)) << "mirrored " << axis;
      const std::vector<Aabb> exchanged = changed(scene.boxes, [&](Aabb& box) {
        std::swap(box.lower[axis], box.lower[(axis + 1) % 3]);
        std::swap(box.upper[axis], box.upper[(axis + 1) % 3]);
      });
      EXPECT_TRUE(same(scene.name, find(exchanged), expected)) << "exchanged " << axis;
    }
  }
}

std::vector<Aabb> scaled(const std::vector<Aabb>& boxes, int exponent) {
  return changed(boxes, [&](Aabb& box) {
    for (float& bound : box.lower) bound = std::ldexp(bound, exponent);
    for (float& bound : box.upper) bound = std::ldexp(bound, exponent);
  });
}

/// From the smallest to the largest power of two that leaves every bound exact; this includes denormal
/// numbers and numbers whose squares overflow.
TEST_P(EachAlgorithm, BoxesMayBeScaledByPowersOfTwo) {
  const std::uint32_t n = is_slow() ? 100 : 400;
  Finder find(config());
  int least_of_all = 0;
  int greatest_of_all = 0;
  for (const scenes::BoxScene& scene : scenes_of(n)) {
    const auto is_exact = [&](int exponent) {
      return scaled(scaled(scene.boxes, exponent), -exponent) == scene.boxes;
    };
    int least = 0;
    while (least > -200 && is_exact(least - 1)) --least;
    int greatest = 0;
    while (greatest < 300 && is_exact(greatest + 1)) ++greatest;
    least_of_all = std::min(least, least_of_all);
    greatest_of_all = std::max(greatest, greatest_of_all);
    const Pairs expected = find(scene.boxes);
    for (const int exponent : {least, least / 2, greatest / 2, greatest}) {
      EXPECT_TRUE(same(scene.name, find(scaled(scene.boxes, exponent)), expected)) << "by 2^" << exponent;
    }
  }
  // Whole numbers become denormal, and denormal ones huge.
  EXPECT_LE(least_of_all, -149);
  EXPECT_GE(greatest_of_all, 250);
}

/// Random motion of n boxes: they drift, and some teleport; at times all gather in clusters or in one place,
/// or scatter.
class Motion {
 public:
  Motion(std::uint32_t n, std::uint64_t seed) : random_(seed) {
    for (std::uint32_t k = 0; k < n; ++k) {
      halves_.emplace_back(random_.vector(0, 1) * (k % 20 == 0 ? 10.0F : 1.0F));
      centres_.push_back(random_.vector(0, world));
      speeds_.push_back(random_.vector(-1, 1));
    }
    halves_.front().setConstant(infinity);
  }

  /// Writes the boxes of the next frame.
  void advance(std::span<Aabb> boxes) {
    const std::uint32_t event = random_.index(40);
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      Eigen::Vector3f& centre = centres_[k];
      centre += speeds_[k];
      if (event == 0)
        centre = Eigen::Vector3f::Constant(static_cast<float>(k % 4) * 10) + random_.vector(0, 3);
      if (event == 1 && k % 2 == 0) centre.setConstant(world / 2);
      if (event == 2) centre += (centre.array() - world / 2).matrix() * 2;  // apart, out of the world
      if (event == 3) centre = random_.vector(0, world);
      if (event > 3 && random_.index(50) == 0) centre = random_.vector(0, world);
      const Eigen::Vector3f lower = centre - halves_[k];
      const Eigen::Vector3f upper = centre + halves_[k];
      boxes[k] = {{lower.x(), lower.y(), lower.z()}, {upper.x(), upper.y(), upper.z()}};
    }
  }

 private:
  static constexpr float world = 40;

  Random random_;
  std::vector<Eigen::Vector3f> centres_, speeds_, halves_;
};

/// An algorithm on the device, by itself.
struct Subject {
  std::string name;
  AlgorithmPointer algorithm;
};

/// Plays the same motion to brute force and to tiles that sort in every frame, now and then, or never again.
void expect_the_same_changes(std::uint32_t n, std::uint32_t frames, std::uint64_t seed) {
  constexpr std::size_t never = std::numeric_limits<std::size_t>::max();
  std::vector<Subject> subjects;
  const auto add = [&](const std::string& name, MakePairFinder make) {
    subjects.push_back({name, make_device_algorithm({}, make)});
    subjects.back().algorithm->reserve(n, false);
  };
  add("brute force", make_brute_force);
  add("sorts now and then", make_tiles);
  add("sorts in every frame", [](const opencl::Context& context) { return make_tiles(context, 0, never); });
  add("never sorts again", [](const opencl::Context& context) {
    return make_tiles(context, static_cast<double>(infinity), never);
  });
  add("searches early", [](const opencl::Context& context) { return make_tiles(context, 1.25, 1); });
  Motion motion(n, seed);
  std::vector<Aabb> boxes(n);
  for (std::uint32_t frame = 0; frame < frames; ++frame) {
    const std::vector<Aabb> before = boxes;
    motion.advance(boxes);
    // In every third frame, few boxes move.
    std::vector<std::uint32_t> ids(n);
    std::iota(ids.begin(), ids.end(), 0);
    if (frame % 3 == 2) {
      std::erase_if(ids, [](std::uint32_t id) { return id % 13 != 0; });
      std::vector<Aabb> next = before;
      for (const std::uint32_t id : ids) next[id] = boxes[id];
      boxes = next;
    }
    const auto update = [&](Algorithm& algorithm) {
      std::copy(boxes.begin(), boxes.end(), algorithm.boxes().begin());
      algorithm.begin({.slots = n, .changed = ids, .all = frame % 3 != 2});
      return algorithm.finish();
    };
    const Delta expected = update(*subjects.front().algorithm);
    for (std::size_t k = 1; k < subjects.size(); ++k) {
      ASSERT_TRUE(same(update(*subjects[k].algorithm), expected.added, expected.removed))
          << subjects[k].name << ", frame " << frame << " of seed " << seed;
    }
  }
  const Pairs pairs = overlapping_pairs(boxes, {.algorithm = "oracle"});
  for (const Subject& subject : subjects) EXPECT_TRUE(same(subject.name, subject.algorithm->pairs(), pairs));
}

NOT_IN(sanitizers, "takes long");
TEST(Tiles, ThousandsOfFramesChangeWhatBruteForceChangesHoweverOftenBoxesAreSorted) {
  expect_the_same_changes(300, is_slow_device() ? 50 : 2000, 1);
}

TEST(Long, TensOfThousandsOfFramesChangeWhatBruteForceChanges) {
  for (std::uint64_t seed = 2; seed < 7; ++seed) expect_the_same_changes(300, 10'000, seed);
  expect_the_same_changes(5000, 1000, 7);
}

}  // namespace
}  // namespace broadcl::test
