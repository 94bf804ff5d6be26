#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletDynamics/Dynamics/btDiscreteDynamicsWorld.h>
#include <BulletDynamics/Dynamics/btRigidBody.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <random>
#include <set>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/bullet.hpp>

#include "each_scenario.hpp"
#include "environment.hpp"
#include "runs.hpp"
#include "scenes/world.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

// ctest runs the tests of this file with rusticl enabled (CMakeLists.txt).
SUITE_NOT_IN(Identical, sanitizers | all_default,
             "needs Mesa, which leaks when it is loaded; a test of its own");
SUITE_ALSO_IN(IdenticalRun, intel);
SUITE_NOT_IN(IdenticalRun, sanitizers | all_default,
             "needs Mesa, which leaks when it is loaded; a test of its own");

/// A pair that enters or leaves a pair cache.
struct Change {
  bool enters;
  int a;
  int b;
  friend bool operator==(const Change&, const Change&) = default;
};

/// Pair caches report every change to it.
class ChangeRecorder final : public btOverlappingPairCallback {
 public:
  btBroadphasePair* addOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t) override {
    changes.push_back({true, s->m_uniqueId, t->m_uniqueId});
    return nullptr;
  }
  void* removeOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t,
                              btDispatcher* /*dispatcher*/) override {
    changes.push_back({false, s->m_uniqueId, t->m_uniqueId});
    return nullptr;
  }
  void removeOverlappingPairsContainingProxy(btBroadphaseProxy* /*proxy*/,
                                             btDispatcher* /*dispatcher*/) override {
    ADD_FAILURE() << "no cache calls this";
  }

  std::vector<Change> changes;
};

/// A hash of every bit of the transforms and velocities.
std::size_t hash_of_motion(const btCollisionWorld& world) {
  std::vector<btScalar> motion;
  const auto append = [&](const btVector3& v) { motion.insert(motion.end(), v.m_floats, v.m_floats + 3); };
  const btCollisionObjectArray& objects = world.getCollisionObjectArray();
  for (int k = 0; k < objects.size(); ++k) {
    const btRigidBody& body = *btRigidBody::upcast(objects[k]);
    append(body.getWorldTransform().getOrigin());
    for (int row = 0; row < 3; ++row) append(body.getWorldTransform().getBasis()[row]);
    append(body.getLinearVelocity());
    append(body.getAngularVelocity());
  }
  const std::string_view bytes(reinterpret_cast<const char*>(motion.data()),
                               motion.size() * sizeof(btScalar));
  return std::hash<std::string_view>()(bytes);
}

/// The results of a run, frame by frame.
struct Traces {
  std::vector<std::size_t> motion;           ///< Hashes.
  std::vector<std::vector<Change>> changes;  ///< In their order.
};

Traces run(const scenes::Scenario::Config& scenario, int frames, const BroadPhase::Config& config) {
  ChangeRecorder recorder;
  BulletBroadphase broadphase(config);
  broadphase.getOverlappingPairCache()->setInternalGhostPairCallback(&recorder);
  scenes::World world(scenario, broadphase);
  Traces result;
  for (int frame = 0; frame < frames; ++frame) {
    world.step();
    result.motion.push_back(hash_of_motion(world.bullet()));
    result.changes.push_back(std::exchange(recorder.changes, {}));
  }
  return result;
}

void expect_same(const Traces& is, const Traces& expected) {
  for (std::size_t frame = 0; frame < expected.motion.size(); ++frame) {
    ASSERT_TRUE(is.changes[frame] == expected.changes[frame]) << "pairs or their order, frame " << frame;
    ASSERT_EQ(is.motion[frame], expected.motion[frame]) << "motion, frame " << frame;
  }
}

/// Memory in blocks of many sizes with holes between them: what is allocated while it exists has other
/// addresses, in another order.
class FragmentedHeap {
 public:
  FragmentedHeap() {
    std::mt19937 random(1);
    for (int k = 0; k < 50'000; ++k) blocks_.emplace_back(16 + random() % 2048);
    std::shuffle(blocks_.begin(), blocks_.end(), random);
    blocks_.resize(blocks_.size() / 2);  // the holes
  }

 private:
  std::vector<std::vector<std::byte>> blocks_;
};

constexpr int short_frames = 64;

/// Scenario, objects, frames.
using Parameters = std::tuple<std::string, std::uint32_t, int>;

class IdenticalRun : public testing::TestWithParam<Parameters> {
 protected:
  [[nodiscard]] static Traces run_on(const BroadPhase::Config& config) {
    const auto& [scenario, objects, frames] = GetParam();
    return run({.name = scenario, .objects = objects}, frames, config);
  }
};

/// The tunings that a device can use. If there are few work-items, llvmpipe ends them too early
/// (host/opencl/context.cpp). With each change, PoCL does without that for GPUs, which it compiles for
/// minutes.
std::vector<std::string> profiles_for(const Device& device, bool all) {
  if (device.name.find("llvmpipe") != std::string::npos) return {"gpu"};
  if (!all && device.platform_name == "Portable Computing Language") return {"cpu"};
  return {"gpu", "cpu"};
}

TEST_P(IdenticalRun, OnEveryDeviceInEveryProfileWithEveryAlgorithm) {
  const Traces expected = run_on({.algorithm = "oracle"});
  std::size_t changes = 0;
  for (const std::vector<Change>& frame : expected.changes) changes += frame.size();
  EXPECT_GT(changes, 100U);
  for (const Device& device : devices()) {
    for (const std::string& profile : profiles_for(device, std::get<int>(GetParam()) > short_frames)) {
      const test::ScopedVariable variable("BROADCL_TUNING", profile);
      for (const AlgorithmInfo& algorithm : algorithms()) {
        if (!algorithm.on_device) continue;
        SCOPED_TRACE(std::string(algorithm.name) + ", profile " + profile + ", on " + device.label());
        expect_same(run_on({.device = device.id(), .algorithm = std::string(algorithm.name)}), expected);
      }
    }
  }
}

TEST_P(IdenticalRun, OnAFragmentedHeap) {
  const Traces expected = run_on({});
  const FragmentedHeap heap;
  expect_same(run_on({}), expected);
}

TEST(Identical, DevicesAreOfTwoImplementationsIfRusticlIsOn) {
  const char* rusticl = std::getenv("RUSTICL_ENABLE");  // NOLINT(concurrency-mt-unsafe)
  if (rusticl == nullptr) GTEST_SKIP() << "RUSTICL_ENABLE is not set";
  std::set<std::string> platforms;
  for (const Device& device : devices()) platforms.insert(device.platform_name);
  EXPECT_GE(platforms.size(), 2U);
}

const auto name_of = [](const auto& test) { return test::test_name(std::get<0>(test.param)); };

INSTANTIATE_TEST_SUITE_P(Identical, IdenticalRun,
                         testing::Combine(testing::Values("mixed-sizes", "streaming"), testing::Values(200U),
                                          testing::Values(short_frames)),
                         name_of);
INSTANTIATE_TEST_SUITE_P(Long, IdenticalRun,
                         testing::Combine(testing::ValuesIn(test::scenario_names()), testing::Values(1000U),
                                          testing::Values(256)),
                         name_of);

}  // namespace
}  // namespace broadcl
