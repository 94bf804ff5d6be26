#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <btBulletDynamicsCommon.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "bullet_rig.hpp"

namespace broadcl {
namespace {

using test::Kind;
using test::kinds;
using test::Rig;

static_assert(sizeof(btScalar) == sizeof(double), "this is the program for double precision");

/// Statement 19 of the contract: boxes that touch at numbers that float32 cannot represent pair.
TEST(BulletFloat64, S19NoPairIsLostByRounding) {
  std::mt19937_64 random(1);  // NOLINT(bugprone-random-generator-seed): the same boxes each time
  std::uniform_real_distribution<double> place(-1000, 1000);
  Rig rig(kinds[0]);
  std::vector<std::pair<btBroadphaseProxy*, btBroadphaseProxy*>> touching;
  for (int k = 0; k < 200; ++k) {
    const double x = place(random);
    const double y = 10.0 * k;  // each two are apart from the others
    touching.emplace_back(rig.create({x - 1, y, -0.1}, {x, y + 1, 0.1}),
                          rig.create({x, y + 1, 0.1}, {x + 1, y + 2, 0.2}));
  }
  rig.calculate();
  for (const auto& [s, t] : touching) EXPECT_TRUE(rig.has(s, t));
  EXPECT_EQ(rig.missing(), 0);
  EXPECT_EQ(rig.pair_count(), 200);
}

/// Boxes apart by an ulp do not pair, before the first calculation and afterwards.
TEST(BulletFloat64, BoxesThatDoNotTouchDoNotPair) {
  for (const double x : {0.0, 1e5, 6.378e6, 1e8}) {
    Rig rig(kinds[0]);
    btBroadphaseProxy* first = rig.create({x, 0, 0}, {x + 1, 1, 1});
    btBroadphaseProxy* second = rig.create({std::nextafter(x + 1, 1e30), 0, 0}, {x + 2, 1, 1});
    rig.calculate();
    EXPECT_EQ(rig.pair_count(), 0);
    rig.move(second, {x + 1, 0, 0}, {x + 2, 1, 1});
    rig.calculate();
    EXPECT_TRUE(rig.has(first, second));
    rig.move(first, {x, 0, 0}, {std::nextafter(x + 1, -1e30), 1, 1});
    rig.calculate();
    EXPECT_EQ(rig.pair_count(), 0);
  }
}

/// A thousand cubes, 0.2 m apart but for those in a row, which touch: Bullet's simple broad phase has 900
/// pairs, wherever they are, and also while they go there.
TEST(BulletFloat64, PairsAreThoseOfBulletAtEveryDistance) {
  for (const double distance : {0.0, 1e5, 1e6, 6.378e6, 1e7}) {
    Rig rig(kinds[0]);
    std::vector<btBroadphaseProxy*> proxies;
    const auto box = [](int k, double from) {
      const int row = k / 10 % 10;
      const int layer = k / 100;
      const btVector3 lower(from + k % 10, 1.2 * row, 1.2 * layer);
      return std::pair(lower, btVector3(lower + btVector3(1, 1, 1)));
    };
    for (int k = 0; k < 1000; ++k) {
      const auto [lower, upper] = box(k, distance / 2);
      proxies.push_back(rig.create(lower, upper));
    }
    for (int frame = 0; frame < 24; ++frame) {
      const double place = std::floor(distance / 2 * (1 + std::min(frame, 20) / 20.0));
      for (int k = 0; k < 1000; ++k) {
        const auto [lower, upper] = box(k, place);
        rig.move(proxies[static_cast<std::size_t>(k)], lower, upper);
      }
      rig.calculate();
      ASSERT_EQ(rig.pair_count(), 900) << place;
    }
    EXPECT_EQ(rig.missing(), 0);
  }
}

TEST(BulletFloat64, BoundsBeyondFloat32Work) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  constexpr double most = std::numeric_limits<double>::max();
  Rig rig(kinds[0]);
  btBroadphaseProxy* unit = rig.create_unit(0);
  btBroadphaseProxy* plane = rig.create({-1e30, -1, -1e30}, {1e30, 0, 1e30});
  btBroadphaseProxy* largest = rig.create({-most, -most, -most}, {most, most, most});
  btBroadphaseProxy* all = rig.create({-infinity, -infinity, -infinity}, {infinity, infinity, infinity});
  btBroadphaseProxy* far = rig.create({1e300, 1e300, 1e300}, {2e300, 2e300, 2e300});
  rig.calculate();
  EXPECT_TRUE(rig.has(unit, plane));
  EXPECT_TRUE(rig.has(unit, largest));
  EXPECT_TRUE(rig.has(unit, all));
  EXPECT_FALSE(rig.has(unit, far));
  EXPECT_TRUE(rig.has(far, largest));
  EXPECT_TRUE(rig.has(far, all));
  EXPECT_FALSE(rig.has(far, plane));
  EXPECT_EQ(rig.missing(), 0);
}

/// An inverted box stays inverted, even if float32 rounds its bounds to the same number.
TEST(BulletFloat64, AnInvertedBoxOverlapsNothing) {
  Rig rig(kinds[0]);
  rig.create({1 + 1e-15, 0, 0}, {1, 1, 1});
  rig.create({0, 0, 0}, {2, 2, 2});
  rig.calculate();
  EXPECT_EQ(rig.pair_count(), 0);
}

/// Collects what a query finds.
class Found final : public btBroadphaseAabbCallback {
 public:
  bool process(const btBroadphaseProxy* proxy) override {
    ids.insert(proxy->m_uniqueId);
    return true;
  }
  std::set<int> ids;
};

/// Queries use the exact bounds, even if a move is less than float32 can represent.
TEST(BulletFloat64, QueriesAreExact) {
  Rig rig(kinds[0]);
  const auto found = [&](double x) {
    Found query;
    rig.broadphase().aabbTest({x, 0, 0}, {x, 1, 1}, query);
    return query.ids;
  };
  for (int k = 0; k < 20; ++k) rig.create({10.0 + k, 5, 5}, {10.5 + k, 6, 6});
  btBroadphaseProxy* box = rig.create({0, 0, 0}, {1, 1, 1});
  const std::set<int> it{box->m_uniqueId};
  for (int k = 0; k < 200; ++k) {  // first by a scan, later by a tree
    EXPECT_EQ(found(1), it);
    EXPECT_TRUE(found(1 + 1e-12).empty());
  }
  rig.move(box, {0, 0, 0}, {1 + 1e-12, 1, 1});
  EXPECT_EQ(box->m_aabbMax.x(), 1 + 1e-12);
  for (int k = 0; k < 200; ++k) EXPECT_EQ(found(1 + 1e-12), it);
}

/// A world of Bullet's build in double precision runs the same way on BroadCL as on Bullet's brute force.
TEST(BulletFloat64, AWorldRunsOnIt) {
  const auto rest_heights = [](const Kind& kind) {
    btDefaultCollisionConfiguration configuration;
    btCollisionDispatcher dispatcher(&configuration);
    const auto broadphase = kind.make(nullptr);
    btSequentialImpulseConstraintSolver solver;
    btDiscreteDynamicsWorld world(&dispatcher, broadphase.get(), &solver, &configuration);
    btStaticPlaneShape plane_shape({0, 1, 0}, 0);
    btBoxShape box_shape(btVector3(0.5, 0.5, 0.5));
    btVector3 inertia;
    box_shape.calculateLocalInertia(1, inertia);
    std::vector<std::unique_ptr<btRigidBody>> bodies;
    bodies.push_back(std::make_unique<btRigidBody>(0, nullptr, &plane_shape));
    for (int k = 0; k < 27; ++k) {
      const int layer = k / 9;
      const int row = k / 3 % 3;
      bodies.push_back(std::make_unique<btRigidBody>(1, nullptr, &box_shape, inertia));
      bodies.back()->getWorldTransform().setOrigin(btVector3(1.1 * (k % 3), 1 + 1.1 * layer, 1.1 * row));
    }
    for (const auto& body : bodies) world.addRigidBody(body.get());
    for (int step = 0; step < 240; ++step) world.stepSimulation(1.0 / 60, 0);
    std::vector<double> heights;
    heights.reserve(bodies.size());
    for (const auto& body : bodies) heights.push_back(body->getWorldTransform().getOrigin().y());
    for (const auto& body : bodies) world.removeRigidBody(body.get());
    return heights;
  };
  const std::vector<double> heights = rest_heights(kinds[0]);
  const std::vector<double> expected = rest_heights(kinds[3]);
  ASSERT_EQ(heights.size(), expected.size());
  for (std::size_t k = 1; k < heights.size(); ++k) {
    EXPECT_GT(heights[k], 0.4);
    EXPECT_NEAR(heights[k], expected[k], 0.05);
  }
}

}  // namespace
}  // namespace broadcl
