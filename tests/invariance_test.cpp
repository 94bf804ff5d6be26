#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace broadcl::test
