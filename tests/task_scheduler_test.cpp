// Worlds simulated by several threads: with a thread-safe Bullet they must have the right pairs; otherwise
// the error must say what is missing.
#include "scenes/task_scheduler.hpp"

#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <LinearMath/btThreads.h>

#include <memory>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "expect_error.hpp"
#include "program.hpp"
#include "scenes/verify.hpp"
#include "scenes/world.hpp"

namespace broadcl::test {
namespace {

using testing::HasSubstr;

const std::string missing_threads = "2 threads need BT_THREADSAFE";

/// Whether Bullet and the tests were built with threads.
bool is_thread_safe() {
#if defined(BT_THREADSAFE) && BT_THREADSAFE
  return std::unique_ptr<btITaskScheduler>(btCreateDefaultTaskScheduler()) != nullptr;
#else
  return false;
#endif
}

TEST(ScopedTaskScheduler, IsBulletsWhileItExists) {
  btITaskScheduler* const before = btGetTaskScheduler();
  if (is_thread_safe()) {
    const scenes::ScopedTaskScheduler scheduler(2);
    EXPECT_NE(btGetTaskScheduler(), before);
    EXPECT_EQ(btGetTaskScheduler()->getNumThreads(), 2);
  } else {
    EXPECT_THAT(error_of([] { const scenes::ScopedTaskScheduler scheduler(2); }), HasSubstr(missing_threads));
  }
  EXPECT_EQ(btGetTaskScheduler(), before);
}

TEST(World, HasTheRightPairsWithSeveralThreadsOrSaysWhatIsMissing) {
  btDbvtBroadphase tree;
  const auto simulate = [&] {
    scenes::World world({.name = "mixed-sizes", .objects = 200}, tree, 2);
    for (int frame = 0; frame < 30; ++frame) {
      world.step();
      EXPECT_EQ(scenes::verify(world.bullet()).missing, 0U) << "frame " << frame;
    }
  };
  if (is_thread_safe()) {
    simulate();
  } else {
    EXPECT_THAT(error_of(simulate), HasSubstr(missing_threads));
  }
}

TEST_F(Program, SimulatesWithSeveralThreadsOrSaysWhatIsMissing) {
  for (const std::string broadphase : {"bullet-bvh", "sweep-and-prune", "tiles"}) {
    SCOPED_TRACE(broadphase);
    const Outcome outcome = run(
        "simulate --objects 200 --frames 30 --threads 2 --verify --json run.json --broadphase " + broadphase);
    if (is_thread_safe()) {
      expect_success(outcome);
      EXPECT_THAT(outcome.out, HasSubstr("seed 1, 2 threads\n"));
      const auto summary = nlohmann::json::parse(read_file(path("run.json")));
      EXPECT_EQ(summary["config"]["threads"], 2);
      EXPECT_EQ(summary["verify"]["equal"], true);
    } else {
      expect_refused(outcome, missing_threads);
    }
  }
}

TEST_F(Program, RefusesToCullWithSeveralThreads) {
  expect_refused(run("simulate --objects 5 --frames 2 --threads 2 --broadphase sweep-and-prune+culling"),
                 is_thread_safe() ? "btCollisionDispatcherMt" : missing_threads);
}

}  // namespace
}  // namespace broadcl::test
