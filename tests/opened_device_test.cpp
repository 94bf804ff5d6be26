#include "opencl/opened_device.hpp"

#include <cstdint>
#include <string>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include "callers_queue.hpp"
#include "each_algorithm.hpp"
#include "environment.hpp"
#include "expect_error.hpp"
#include "failing_opencl.hpp"
#include "opencl/context.hpp"
#include "patience.hpp"
#include "runs.hpp"

/// What objects that work on the same device share.
namespace broadcl::test {
namespace {

SUITE_ALSO_IN(OpenedDevices, rusticl);

Pairs pairs_after_frames(BroadPhase& broad_phase, std::uint32_t seed) {
  for (std::uint32_t k = 0; k < 50; ++k) broad_phase.add(apart(k));
  (void)broad_phase.update();
  for (std::uint32_t k = 0; k < 50; k += seed) broad_phase.move(k, unit);
  return to_vector(broad_phase.update().added);
}

TEST_P(EachAlgorithm, TheSecondObjectBuildsNoPrograms) {
  BroadPhase first(config());
  const Pairs pairs = pairs_after_frames(first, 3);
  const long built = opencl_use().programs_built;
  BroadPhase second(config());
  EXPECT_NE(pairs_after_frames(second, 2), pairs);
  EXPECT_EQ(pairs_after_frames(second, 2).size(), 0U) << "all moved before";
  BroadPhase third(config());
  EXPECT_EQ(pairs_after_frames(third, 3), pairs);
  EXPECT_EQ(opencl_use().programs_built, built);
}

TEST(OpenedDevices, StayOpenWhileNobodyUsesThem) {
  auto* const first = opencl::Context(select_device(), false).context()();
  EXPECT_EQ(opencl::Context(select_device(), false).context()(), first);
}

TEST(OpenedDevices, AreOpenedAnewAfterAFailure) {
  const opencl::Context first(select_device(), false);
  {
    const opencl::Context same(select_device(), false);
    ASSERT_EQ(same.context()(), first.context()());
    EXPECT_FALSE(error_of([&] { same.guard([&] { (void)same.buffer(0); }); }).empty());
  }
  const opencl::Context second(select_device(), false);
  EXPECT_NE(second.context()(), first.context()());
  EXPECT_EQ(opencl::Context(select_device(), false).context()(), second.context()());
}

TEST(OpenedDevices, OfOtherSettingsAreOthers) {
  const ScopedVariable by_the_device("BROADCL_TUNING", "");
  const opencl::Context first(select_device(), false);
  for (const char* variable : {"BROADCL_TUNING", "BROADCL_CACHE_DIR"}) {
    const ScopedVariable other(variable, std::string(variable) == "BROADCL_TUNING" ? "gpu" : "/dev/null");
    EXPECT_NE(opencl::Context(select_device(), false).context()(), first.context()()) << variable;
  }
}

TEST(OpenedDevices, KeepWhatIsBuiltForQueuesOfTheirContext) {
  const opencl::Context own(select_device(), false);
  const cl::CommandQueue queue(own.context(), own.queue().getInfo<CL_QUEUE_DEVICE>());
  { const DeviceBroadPhase first(queue()); }
  const long built = opencl_use().programs_built;
  const DeviceBroadPhase second(queue());
  EXPECT_EQ(opencl_use().programs_built, built);
}

TEST(OpenedDevices, OfACallerLastAsLongAsTheirObjects) {
  const CallersQueue queue;
  const cl::CommandQueue callers(queue(), true);
  const auto context = callers.getInfo<CL_QUEUE_CONTEXT>();
  const auto references = [&] { return context.getInfo<CL_CONTEXT_REFERENCE_COUNT>(); };
  const cl_uint before = references();
  {
    const DeviceBroadPhase first(queue());
    const long built = opencl_use().programs_built;
    const DeviceBroadPhase second(queue());
    EXPECT_EQ(opencl_use().programs_built, built);
    EXPECT_GT(references(), before);
  }
  EXPECT_TRUE(eventually([&] { return references() == before; }));
}

TEST(OpenedDevices, AHandlerOfCompilationsMayUseTheLibrary) {
  const ScopedFolder folder;
  const ScopedVariable cache("BROADCL_CACHE_DIR", folder.path().string());
  int calls = 0;
  BroadPhase broad_phase(
      {.algorithm = "tiles", .on_compile = [&](const Device& /*device*/, const std::string&) {
         BroadPhase other({.algorithm = "tiles"});
         calls += static_cast<int>(pairs_after_frames(other, 3).size());
       }});
  EXPECT_EQ(pairs_after_frames(broad_phase, 3).size(), static_cast<std::size_t>(calls));
}

}  // namespace
}  // namespace broadcl::test
