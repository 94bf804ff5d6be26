#include "scenes/scenario.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <broadcl/broad_phase.hpp>
#include <cmath>
#include <cstddef>
#include <ctime>
#include <set>
#include <string>
#include <vector>

#include "each_scenario.hpp"
#include "expect_error.hpp"
#include "runs.hpp"
#include "test_name.hpp"

namespace broadcl::scenes {
namespace {

std::vector<Aabb> start_boxes(const Scenario& scenario) {
  std::vector<Aabb> boxes;
  for (const auto& [position, velocity, edge] : scenario.objects()) {
    const Eigen::Vector3f lower = position.array() - edge / 2;
    const Eigen::Vector3f upper = position.array() + edge / 2;
    boxes.push_back({{lower.x(), lower.y(), lower.z()}, {upper.x(), upper.y(), upper.z()}});
  }
  return boxes;
}

bool is_inside(const Aabb& box, float container_edge) {
  const float half = container_edge / 2;
  return std::all_of(box.lower.begin(), box.lower.end(), [&](float x) { return x >= -half; }) &&
         std::all_of(box.upper.begin(), box.upper.end(), [&](float x) { return x <= half; });
}

bool have_same_start(const Scenario& s, const Scenario& t) {
  return std::equal(s.objects().begin(), s.objects().end(), t.objects().begin(), t.objects().end(),
                    [](const Scenario::Object& a, const Scenario::Object& b) {
                      return a.position == b.position && a.velocity == b.velocity && a.edge == b.edge;
                    });
}

class EachScenario : public testing::TestWithParam<std::string> {};

NOT_IN(sanitizers, "takes long");
TEST_P(EachScenario, StartsWithoutOverlapInsideTheContainer) {
  for (const std::uint32_t objects : {1U, 2U, 3U, 6U, 7U, 9U, 100U, 500U, 1250U, 2000U, 2750U, 3500U}) {
    for (const std::uint64_t seed : {1U, 2U, 3U, 4U, 5U}) {
      SCOPED_TRACE(std::to_string(objects) + " objects, seed " + std::to_string(seed));
      const Scenario scenario({.name = GetParam(), .objects = objects, .seed = seed});
      const std::vector<Aabb> boxes = start_boxes(scenario);
      ASSERT_EQ(boxes.size(), objects);
      for (const Aabb& box : boxes) ASSERT_TRUE(is_inside(box, scenario.container_edge()));
      ASSERT_TRUE(overlapping_pairs(boxes, {}, {.algorithm = "oracle"}).empty());
    }
  }
}

TEST_P(EachScenario, StartsAnywhereInTheContainer) {
  const Scenario scenario({.name = GetParam(), .objects = 3500});
  std::array<int, 8> count_by_octant{};
  for (const Scenario::Object& object : scenario.objects()) {
    const auto& p = object.position;
    ++count_by_octant.at((p.x() < 0 ? 0U : 1U) + (p.y() < 0 ? 0U : 2U) + (p.z() < 0 ? 0U : 4U));
  }
  EXPECT_THAT(count_by_octant, testing::Each(testing::AllOf(testing::Gt(350), testing::Lt(525))));
}

NOT_IN(sanitizers, "measures time");
TEST_P(EachScenario, FindsPlaceForManyObjectsQuickly) {
  const std::clock_t start = std::clock();  // processor time
  const Scenario scenario({.name = GetParam(), .objects = 100'000});
  EXPECT_EQ(scenario.objects().size(), 100'000U);
  EXPECT_LT(std::clock() - start, 20 * CLOCKS_PER_SEC);
}

TEST_P(EachScenario, StartsWithSpeedsInRange) {
  const Scenario scenario({.name = GetParam()});
  Eigen::AlignedBox3f velocities;
  for (const Scenario::Object& object : scenario.objects()) velocities.extend(object.velocity);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_GE(velocities.min()[axis], -10);
    EXPECT_LT(velocities.min()[axis], -9.9F);
    EXPECT_GT(velocities.max()[axis], 9.9F);
    EXPECT_LE(velocities.max()[axis], 10);
  }
}

TEST_P(EachScenario, FollowsFromItsSeed) {
  Scenario s({.name = GetParam(), .seed = 7});
  Scenario t({.name = GetParam(), .seed = 7});
  EXPECT_TRUE(have_same_start(s, t));
  for (int frame = 0; frame < 100; ++frame) {
    ASSERT_EQ(s.gravity(), t.gravity());
    ASSERT_TRUE(std::equal(s.kicks().begin(), s.kicks().end(), t.kicks().begin(), t.kicks().end(),
                           [](const Scenario::Kick& a, const Scenario::Kick& b) {
                             return a.object == b.object && a.velocity == b.velocity;
                           }));
    ASSERT_TRUE(std::equal(s.exchanges().begin(), s.exchanges().end(), t.exchanges().begin(),
                           t.exchanges().end(), [](const auto& a, const auto& b) {
                             return a.object == b.object && a.position == b.position &&
                                    a.velocity == b.velocity;
                           }));
    s.advance();
    t.advance();
  }
  EXPECT_FALSE(have_same_start(s, Scenario({.name = GetParam(), .seed = 8})));
}

TEST_P(EachScenario, PlacesSpheresAsCubes) {
  EXPECT_TRUE(have_same_start(Scenario({.name = GetParam()}),
                              Scenario({.name = GetParam(), .objects = 1250, .seed = 1, .spheres = true})));
}

INSTANTIATE_TEST_SUITE_P(Scenario, EachScenario, testing::ValuesIn(test::scenario_names()),
                         test::named_by_parameter);

TEST(Scenario, ListsTheFourOfThePaperAndOneMore) {
  EXPECT_THAT(test::scenario_names(),
              testing::ElementsAre("free-fall", "agitated", "rolling-gravity", "mixed-sizes", "streaming"));
}

TEST(Scenario, StreamsFivePercentASecondInOnTop) {
  for (const std::uint32_t objects : {7U, 1250U}) {
    Scenario scenario({.name = "streaming", .objects = objects});
    EXPECT_TRUE(scenario.exchanges().empty()) << "at the start";
    std::size_t exchanged = 0;
    for (int frame = 0; frame < 900; ++frame, scenario.advance()) {
      std::set<std::uint32_t> leaving;
      for (const Scenario::Exchange& exchange : scenario.exchanges()) {
        EXPECT_TRUE(leaving.insert(exchange.object).second) << "each object leaves once";
        const float half_edge = scenario.objects()[exchange.object].edge / 2;
        EXPECT_LE((exchange.position.array().abs() + half_edge).maxCoeff(),
                  scenario.container_edge() / 2 * 1.00001F);
        EXPECT_GT(exchange.position.y() + 1.001F * half_edge, scenario.container_edge() / 2) << "on top";
      }
      exchanged += leaving.size();
    }
    EXPECT_NEAR(static_cast<double>(exchanged), 0.05 * 30 * objects, 1 + 0.002 * objects);
  }
}

TEST(Scenario, RefusesWhatItCannotSimulate) {
  EXPECT_THAT(
      test::error_of([] { Scenario({.name = "free-fal"}); }),
      testing::AllOf(testing::HasSubstr("'free-fal'"),
                     testing::HasSubstr("free-fall, agitated, rolling-gravity, mixed-sizes, streaming")));
  EXPECT_THAT(test::error_of([] { Scenario({.name = "free-fall", .objects = 0}); }),
              testing::HasSubstr("1 to 16777216 objects"));
  EXPECT_THAT(test::error_of([] { Scenario({.name = "free-fall", .objects = Scenario::max_objects + 1}); }),
              testing::HasSubstr("not 16777217"));
}

TEST(Scenario, SizesTheContainerByTheVolumeOfTheObjects) {
  EXPECT_FLOAT_EQ(Scenario({.name = "free-fall", .objects = 1000}).container_edge(), 20);
  EXPECT_FLOAT_EQ(Scenario({.name = "agitated", .objects = 8}).container_edge(), 4);
  EXPECT_FLOAT_EQ(Scenario({.name = "rolling-gravity", .objects = 1}).container_edge(), 2);
  EXPECT_NEAR(Scenario({.name = "mixed-sizes", .objects = 3500}).container_edge(),
              2 * std::cbrt(9.015 * 3500), 0.01);
}

TEST(Scenario, GivesEqualSizesInAllButMixedSizes) {
  for (const char* name : {"free-fall", "agitated", "rolling-gravity"}) {
    const Scenario scenario({.name = name});
    for (const Scenario::Object& object : scenario.objects()) ASSERT_EQ(object.edge, 1);
  }
}

TEST(Scenario, MixesAThirdOfEachSize) {
  const Scenario scenario({.name = "mixed-sizes", .objects = 3500});
  std::array<std::vector<std::size_t>, 3> objects_by_class;
  std::array<Eigen::AlignedBox1f, 3> range_by_class;
  for (std::size_t k = 0; k < scenario.objects().size(); ++k) {
    const float edge = scenario.objects()[k].edge;
    const std::size_t size_class = edge < 0.6F ? 0 : edge < 1.4F ? 1 : 2;
    objects_by_class.at(size_class).push_back(k);
    range_by_class.at(size_class).extend(Eigen::Matrix<float, 1, 1>(edge));
  }
  constexpr std::array<SizeClass, 3> expected{{{0.1F, 0.4F}, {0.8F, 1.2F}, {1.6F, 4.0F}}};
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(static_cast<double>(objects_by_class.at(k).size()), 3500 / 3.0, 1);
    EXPECT_GE(range_by_class.at(k).min()[0], expected.at(k).lower);
    EXPECT_LE(range_by_class.at(k).max()[0], expected.at(k).upper);
    EXPECT_GT(range_by_class.at(k).sizes()[0], 0.97F * (expected.at(k).upper - expected.at(k).lower));
    // The ids of each class are spread: a third of all ids has about a third of each class.
    const auto early = std::count_if(objects_by_class.at(k).begin(), objects_by_class.at(k).end(),
                                     [](std::size_t object) { return object < 1167; });
    EXPECT_NEAR(static_cast<double>(early), 389, 60);
  }
}

TEST(Scenario, KicksTwentyFiveDistinctObjectsAFrame) {
  Scenario scenario({.name = "agitated", .objects = 30});
  std::set<std::uint32_t> ever;
  for (int frame = 0; frame < 100; ++frame) {
    std::set<std::uint32_t> now;
    for (const Scenario::Kick& kick : scenario.kicks()) {
      EXPECT_LT(kick.object, 30U);
      EXPECT_LE(kick.velocity.cwiseAbs().maxCoeff(), 10);
      EXPECT_TRUE(now.insert(kick.object).second) << "kicked twice";
    }
    EXPECT_EQ(now.size(), 25U);
    ever.merge(now);
    scenario.advance();
  }
  EXPECT_EQ(ever.size(), 30U);
}

TEST(Scenario, KicksAllObjectsIfThereAreFewer) {
  EXPECT_EQ(Scenario({.name = "agitated", .objects = 7}).kicks().size(), 7U);
}

TEST(Scenario, KicksNobodyInOtherScenarios) {
  for (const char* name : {"free-fall", "rolling-gravity", "mixed-sizes"}) {
    Scenario scenario({.name = name});
    EXPECT_TRUE(scenario.kicks().empty());
    scenario.advance();
    EXPECT_TRUE(scenario.kicks().empty());
  }
}

TEST(Scenario, PullsDownSteadilyUnlessGravityRotates) {
  for (const char* name : {"free-fall", "agitated"}) {
    Scenario scenario({.name = name});
    EXPECT_FALSE(scenario.gravity_rotates());
    scenario.advance();
    EXPECT_EQ(scenario.gravity(), Eigen::Vector3f(0, -9.798F, 0));
  }
}

class EachRollingScenario : public testing::TestWithParam<std::string> {};

TEST_P(EachRollingScenario, RotatesGravityAsThePaperSays) {
  Scenario scenario({.name = GetParam()});
  EXPECT_TRUE(scenario.gravity_rotates());
  EXPECT_EQ(scenario.gravity(), Eigen::Vector3f(0, -50 * 9.798F, 0));

  scenario.advance();  // about x
  const float angle = 1.0F / 120;
  const Eigen::Vector3f after_one = 489.9F * Eigen::Vector3f(0, -std::cos(angle), -std::sin(angle));
  EXPECT_TRUE(scenario.gravity().isApprox(after_one, 1e-6F));

  scenario.advance();  // about x rotated about y
  const Eigen::Vector3f axis(std::cos(angle), 0, -std::sin(angle));
  EXPECT_TRUE(scenario.gravity().isApprox(Eigen::AngleAxisf(angle, axis) * after_one, 1e-6F));
}

TEST_P(EachRollingScenario, PullsTowardsAllSixFaces) {
  Scenario scenario({.name = GetParam()});
  std::set<std::pair<int, bool>> faces;
  for (int frame = 0; frame < 2048; ++frame) {
    const Eigen::Vector3f& gravity = scenario.gravity();
    EXPECT_NEAR(gravity.norm(), 489.9F, 0.05F);
    int axis = 0;
    gravity.cwiseAbs().maxCoeff(&axis);
    faces.emplace(axis, gravity[axis] > 0);
    scenario.advance();
  }
  EXPECT_EQ(faces.size(), 6U);
}

INSTANTIATE_TEST_SUITE_P(Scenario, EachRollingScenario, testing::Values("rolling-gravity", "mixed-sizes"),
                         test::named_by_parameter);

}  // namespace
}  // namespace broadcl::scenes
