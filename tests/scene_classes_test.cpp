#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "cli/box_file.hpp"
#include "each_algorithm.hpp"
#include "scenes/generators.hpp"
#include "scenes/random.hpp"
#include "twins.hpp"

/// Kinds of scenes that break broad phases, static and in motion, and boxes of real simulations.
namespace broadcl::test {
namespace {

using scenes::Random;

Aabb box_at(const Eigen::Vector3f& lower, const Eigen::Vector3f& edges) {
  const Eigen::Vector3f upper = lower + edges;
  return {{lower.x(), lower.y(), lower.z()}, {upper.x(), upper.y(), upper.z()}};
}

Aabb small_box(Random& random) {
  return box_at(random.vector(0, 100), random.vector(0, 6));
}

/// A slab, a column or a block as long as the world: finite, half infinite or infinite.
Aabb large_box(Random& random) {
  Aabb box = small_box(random);
  const std::uint32_t axes = 1 + random.index(7);
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    if ((axes >> axis & 1U) == 0) continue;
    const std::uint32_t kind = random.index(4);
    box.lower[axis] = kind == 1 ? -infinity : random.uniform(-50, 20);
    box.upper[axis] = kind == 2 ? infinity : random.uniform(80, 150);
    if (kind == 3) box.upper[axis] = 1e18F;
  }
  return box;
}

/// A class of scenes: draws box k of n.
struct SceneClass {
  std::string name;
  std::function<Aabb(std::uint32_t k, std::uint32_t n, Random& random)> draw;
};

/// The classes that are not in scenes::box_scenes().
std::vector<SceneClass> classes() {
  using Index = std::uint32_t;
  return {
      {"planes on all sides of a world",
       [](Index k, Index /*n*/, Random& random) {
         Aabb box = small_box(random);
         if (k >= 6) return box;
         box = {{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}};
         (k < 3 ? box.upper : box.lower)[k % 3] = k < 3 ? 1.0F : 99.0F;
         return box;
       }},
      {"a tenth large",
       [](Index /*k*/, Index /*n*/, Random& random) {
         return random.index(10) == 0 ? large_box(random) : small_box(random);
       }},
      {"large alone", [](Index /*k*/, Index /*n*/, Random& random) { return large_box(random); }},
      {"edges from a thousandth to a quarter of the world",
       [](Index /*k*/, Index /*n*/, Random& random) {
         return box_at(random.vector(0, 100), random.vector(0.5F, 1) * 25 * std::exp2(random.uniform(-8, 0)));
       }},
      {"around an eighth of the world",
       [](Index /*k*/, Index /*n*/, Random& random) {
         return box_at(random.vector(0, 100), Eigen::Vector3f::Constant(random.uniform(12, 13)));
       }},
      {"points in one point",
       [](Index /*k*/, Index /*n*/, Random& /*random*/) {
         return Aabb{{1, 2, 3}, {1, 2, 3}};
       }},
      {"boxes around one point",
       [](Index /*k*/, Index /*n*/, Random& random) {
         const Eigen::Vector3f half = random.vector(0, 1);
         return box_at(-half, 2 * half);
       }},
      {"two points and nothing between",
       [](Index k, Index /*n*/, Random& /*random*/) {
         const float x = k % 2 == 0 ? -1e20F : 1e20F;
         return Aabb{{x, x, 0}, {x, x, 0}};
       }},
      {"a cluster and a few boxes far away",
       [](Index k, Index n, Random& random) {
         if (k % (n / 5 + 1) == 0) return box_at(random.vector(-1e9F, 1e9F), Eigen::Vector3f::Constant(100));
         return box_at(random.vector(0, 1), random.vector(0, 0.1F));
       }},
      {"clusters of clusters",
       [](Index /*k*/, Index /*n*/, Random& random) {
         Eigen::Vector3f place = Eigen::Vector3f::Zero();
         for (const float scale : {1e6F, 1e4F, 1e2F}) {
           place += Eigen::Vector3f(static_cast<float>(random.index(2)), static_cast<float>(random.index(2)),
                                    static_cast<float>(random.index(2))) *
                    scale;
         }
         return box_at(place + random.vector(0, 1), random.vector(0, 0.2F));
       }},
      {"a sheet of boxes without thickness, in a plane and across it",
       [](Index k, Index /*n*/, Random& random) {
         Eigen::Vector3f lower = random.vector(0, 100);
         Eigen::Vector3f edges = random.vector(0, 10);
         lower.z() = 5;
         edges[static_cast<int>(k % 3)] = 0;
         return box_at(lower, edges);
       }},
      {"a chain along a diagonal",
       [](Index k, Index /*n*/, Random& /*random*/) {
         return box_at(Eigen::Vector3f::Constant(static_cast<float>(k)), Eigen::Vector3f::Ones());
       }},
      {"far from the origin, and mixed",
       [](Index /*k*/, Index /*n*/, Random& random) {
         return box_at(random.vector(0, 64).array() + 1e6F,
                       random.vector(0, 2).cwiseProduct(random.vector(0, 4)));
       }},
      {"far from the origin, the world a few floats wide",
       [](Index /*k*/, Index /*n*/, Random& random) {
         return box_at(random.vector(0, 40).array() - 3e7F, random.vector(0, 8));
       }},
  };
}

/// A scene of a class; a different one for each seed.
std::vector<Aabb> draw(const SceneClass& scene, std::uint32_t n, std::uint64_t seed) {
  Random random(seed);
  std::vector<Aabb> boxes;
  for (std::uint32_t k = 0; k < n; ++k) boxes.push_back(scene.draw(k, n, random));
  return boxes;
}

/// Frames in which few, many or all boxes become those of other scenes of the class, or change places with
/// each other, or drift.
::testing::AssertionResult follow(const BroadPhase::Config& config,
                                  const std::function<std::vector<Aabb>(std::uint64_t seed)>& scene) {
  std::vector<Aabb> boxes = scene(1);
  const auto n = static_cast<std::uint32_t>(boxes.size());
  Twins twins(config);
  for (const Aabb& box : boxes) twins.add(box);
  ::testing::AssertionResult result = twins.agree();
  const auto move = [&](const std::vector<Aabb>& next, std::uint32_t step, const std::string& what) {
    if (!result) return;
    for (std::uint32_t id = 0; id < n; id += step) twins.move(id, boxes[id] = next[id]);
    result = twins.agree();
    if (!result) result << ", " << what;
  };
  move(scene(2), n / 3 + 1, "few");
  move(scene(3), 3, "many");
  move(scene(4), 1, "all");
  std::vector<Aabb> next = boxes;
  std::rotate(next.begin(), next.begin() + n / 3, next.end());
  move(next, 1, "exchanged");
  for (int frame = 0; frame < 3; ++frame) {
    next = boxes;
    for (std::uint32_t id = 0; id < n; ++id) {
      const std::size_t axis = id % 3;
      const float step = (next[id].upper[axis] - next[id].lower[axis]) * (id % 2 == 0 ? 0.25F : -0.25F);
      if (!std::isfinite(step)) continue;
      next[id].lower[axis] += step;
      next[id].upper[axis] += step;
    }
    move(next, 1, "drift");
  }
  return result;
}

TEST_P(LongEachAlgorithm, EveryClassOfScenesInMotionFollowsTheOracle) {
  for (const std::uint32_t n : {33U, 300U, 1100U}) {
    if (n > 1000 && is_slow()) continue;
    for (const SceneClass& scene : classes()) {
      EXPECT_TRUE(follow(config(), [&](std::uint64_t seed) { return draw(scene, n, seed); }))
          << scene.name << ", " << n;
    }
  }
}

TEST_P(LongEachAlgorithm, EveryKindOfSceneInMotionFollowsTheOracle) {
  for (const std::uint32_t n : {10U, is_slow() ? 100U : 400U}) {
    for (std::size_t k = 0; k < scenes::box_scenes(n).size(); ++k) {
      const auto scene = [&](std::uint64_t seed) { return scenes::box_scenes(n, seed)[k].boxes; };
      EXPECT_TRUE(follow(config(), scene)) << scenes::box_scenes(n)[k].name << ", " << n;
    }
  }
}

ALSO_IN(oclgrind);
NOT_IN(sanitizers, "takes long");
TEST_P(EachAlgorithm, SmallClassesOfScenesAgreeWithTheOracle) {
  for (const SceneClass& scene : classes()) expect_oracle(draw(scene, 40, 1), scene.name);
}

/// Sizes for which a spatial order has several levels.
NOT_IN(all_default | gpu_profile | rusticl | sanitizers, "takes long");
TEST_P(EachAlgorithm, ThousandsOfBoxesOfEveryClassAgreeWithTheOracle) {
  const std::uint32_t n = is_slow() ? 1025 : 2049;
  for (const SceneClass& scene : classes()) expect_oracle(draw(scene, n, 1), scene.name);
  for (const scenes::BoxScene& scene : scenes::box_scenes(n)) expect_oracle(scene.boxes, scene.name);
}

/// Boxes of real simulations, and the number of overlapping pairs, which other programs counted.
struct RealBoxes {
  std::string file;
  std::size_t boxes, pairs;
};

NOT_IN(gpu_profile | rusticl | sanitizers, "takes long, and boxes may be missing");
TEST_P(EachAlgorithm, RealBoxesHaveThePairsThatWereCounted) {
  const char* folder = std::getenv("BROADCL_TEST_DATA");
  if (folder == nullptr) GTEST_SKIP() << "BROADCL_TEST_DATA does not name the folder of the real boxes";
  // The most boxes for which it takes seconds, not minutes.
  const std::string name(GetParam().name);
  std::size_t most = 30'000;
  if (name == "gpu-bf" || is_slow()) most = 20'000;
  if (name == "brute-force" && !is_slow() && std::getenv("BROADCL_TUNING") == nullptr) most = 100'000;
  if (name == "tiles") most = 200'000;
  const std::string other = name == "tiles" ? "sweep-and-prune" : "tiles";
  for (const RealBoxes& real : {RealBoxes{"cloth-funnel-faces.npy", 18'484, 153'821},
                                RealBoxes{"cloth-funnel-edges.npy", 27'930, 172'385},
                                RealBoxes{"cloth-ball-faces.npy", 92'230, 4'539'382},
                                RealBoxes{"cloth-ball-edges.npy", 138'825, 5'901'866}}) {
    if (real.boxes > most) continue;
    const std::vector<Aabb> boxes = cli::read_boxes(std::filesystem::path(folder) / real.file).as_float32();
    ASSERT_EQ(boxes.size(), real.boxes);
    const Pairs pairs = overlapping_pairs(boxes, {}, config());
    EXPECT_EQ(pairs.size(), real.pairs) << real.file;
    EXPECT_TRUE(same(real.file, pairs, overlapping_pairs(boxes, {}, {.algorithm = other})));
  }
}

/// More boxes than fit below one root. Ids are scattered; each box touches the next along x, and no other.
NOT_IN(sanitizers, "takes long");
TEST(Tiles, MoreThanAMillionBoxes) {
  if (is_slow_device()) GTEST_SKIP() << "takes minutes on this device";
  constexpr std::uint32_t edge = 102;
  constexpr std::uint32_t n = edge * edge * edge;
  static_assert(n > 1U << 20);
  const auto id = [](std::uint32_t k) { return static_cast<std::uint32_t>(std::uint64_t{k} * 7919 % n); };
  BroadPhase broad_phase({.algorithm = "tiles"});
  const std::span<Aabb> boxes = broad_phase.map(n);
  Pairs expected;
  for (std::uint32_t k = 0; k < n; ++k) {
    const std::uint32_t x = k % edge;
    const std::uint32_t row = k / edge % edge;
    const std::uint32_t layer = k / edge / edge;
    const auto y = static_cast<float>(2 * row);
    const auto z = static_cast<float>(2 * layer);
    const auto lower = static_cast<float>(x);
    boxes[id(k)] = {{lower, y, z}, {lower + 1, y + 1, z + 1}};
    if (x > 0) expected.push_back({std::min(id(k - 1), id(k)), std::max(id(k - 1), id(k))});
  }
  std::sort(expected.begin(), expected.end());
  EXPECT_TRUE(same(broad_phase.update(), expected, {}));
}

}  // namespace
}  // namespace broadcl::test
