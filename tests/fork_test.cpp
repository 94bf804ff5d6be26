#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/device.hpp>
#include <broadcl/opencl.hpp>

#include "base/parallel.hpp"
#include "base/thread_pool.hpp"
#include "callers_queue.hpp"
#include "cli/recording.hpp"
#include "core/core.hpp"
#include "each_algorithm.hpp"
#include "engines/hybrid.hpp"
#include "environment.hpp"
#include "expect_error.hpp"
#include "forked_child.hpp"
#include "pretender.hpp"
#include "runs.hpp"
#include "started_threads.hpp"
#include "twins.hpp"

/// A process that is forked after OpenCL was used.
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

void expect_refused(const std::function<void()>& function) {
  EXPECT_THAT(error_of(function), HasSubstr("after a fork"));
}

TEST(Fork, TheChildHasThreadsOfItsOwn) {
  const auto count = [&] {
    std::atomic<std::size_t> sum = 0;
    parallel_for(1000, 3, [&](std::size_t /*k*/, std::size_t /*thread*/) { ++sum; });
    return sum.load();
  };
  ASSERT_EQ(count(), 1000U);
  EXPECT_TRUE(holds_in_child([&] {
    const long before = started_threads();
    for (int k = 0; k < 10; ++k) EXPECT_EQ(count(), 1000U);
    EXPECT_EQ(started_threads(), before + 2);
  }));
  EXPECT_EQ(count(), 1000U);
}

TEST(Fork, NoProcessorOfTheChildIsLeftToAThreadOfTheParent) {
  const std::size_t all = free_processors();
  EXPECT_EQ(all, usable_processors());
  {
    const BackgroundWork work;
    EXPECT_EQ(free_processors(), all < 4 ? all : all - 1);
    EXPECT_TRUE(holds_in_child([&] { EXPECT_EQ(free_processors(), all); }));
  }
  EXPECT_EQ(free_processors(), all);
}

TEST(Fork, NoDeviceCanBeUsedInTheChild) {
  const Device device = select_device();
  EXPECT_TRUE(holds_in_child([&] {
    expect_refused([] { (void)devices(); });
    std::vector<std::string> failures;
    expect_refused([&] { (void)devices(&failures); });
    expect_refused([] { (void)select_device(); });
    for (const AlgorithmInfo& algorithm : algorithms()) {
      const BroadPhase::Config config{.algorithm = std::string(algorithm.name)};
      if (!algorithm.on_device || algorithm.name == "auto") {
        EXPECT_TRUE(Twins(config).agree()) << algorithm.name;
      } else {
        expect_refused([&] { const BroadPhase refused(config); });
      }
    }
    const ScopedVariable named("BROADCL_DEVICE", device.id());
    Twins twins({.algorithm = "auto"});
    for (std::size_t k = 0; k < 300; ++k) twins.add(unit);
    EXPECT_TRUE(twins.agree());
    EXPECT_EQ(twins.tested().device(), nullptr);
  }));
}

TEST_P(EachAlgorithm, OnADeviceIsRefusedAndCanBeDestroyedInAForkedChild) {
  const Device device = select_device();
  const auto make = [] {
    auto broad_phase = std::make_unique<BroadPhase>(config());
    broad_phase->map(300);
    for (std::uint32_t id = 0; id < 300; ++id) broad_phase->move(id, unit);
    return broad_phase;
  };
  auto updated = make();
  std::optional<Delta> delta = updated->update();
  std::vector<std::uint32_t> asked;
  EXPECT_EQ(updated->overlapping(unit, asked), 300U);
  const std::size_t pairs = delta->added.size();
  auto begun = make();
  begun->begin();
  std::optional<MappedBoxes> boxes = updated->map(updated->size());
  EXPECT_TRUE(holds_in_child([&] {
    if (updated->device() == nullptr) {
      updated->remove(7);
      EXPECT_EQ(updated->update().removed.size(), 299U);
      const std::vector<Aabb> queries(100, unit);
      EXPECT_EQ(updated->overlapping(queries).ids.size(), 299U * 100U);
      EXPECT_EQ(updated->partners(1).size(), 298U);
      EXPECT_EQ(begun->finish().added.size(), pairs);
    } else {
      expect_refused([&] { updated->add(unit); });
      expect_refused([&] { (void)updated->overlapping(BoxView(std::span(&unit, 1))); });
      expect_refused([&] { (void)updated->partners(1); });
      expect_refused([&] { updated->move(1, unit); });
      expect_refused([&] { updated->remove(1); });
      const std::vector<Aabb> given(300, unit);
      const std::vector<std::uint32_t> ids{1, 2};
      expect_refused([&] { updated->add(given); });
      expect_refused([&] { updated->move(ids, std::span(given).first(2)); });
      expect_refused([&] { updated->remove(ids); });
      expect_refused([&] { (void)updated->box(1); });
      expect_refused([&] { updated->update(given); });
      expect_refused([&] { updated->begin(given); });
      expect_refused([&] { updated->map(10); });
      expect_refused([&] { updated->update(); });
      expect_refused([&] { updated->begin(); });
      expect_refused([&] { updated->shrink(); });
      expect_refused([&] { (void)updated->pairs(); });
      expect_refused([&] { begun->finish(); });
    }
    updated = std::make_unique<BroadPhase>(BroadPhase::Config{.algorithm = "oracle"});
    *begun = std::move(*updated);
    begun.reset();
    boxes.reset();
    delta.reset();
  }));
  EXPECT_EQ(begun->finish().added.size(), pairs);  // the parent goes on
  EXPECT_EQ(updated->pairs().size(), pairs);
}

TEST(Fork, ADeviceBroadPhaseIsRefusedAndCanBeDestroyedInTheChild) {
  const CallersQueue queue;
  auto broad_phase = std::make_unique<DeviceBroadPhase>(queue());
  const cl::Buffer boxes = queue.buffer_of(std::vector<Aabb>(100, unit));
  const DeviceBroadPhase::Boxes given{.buffer = boxes(), .count = 100};
  broad_phase->update(given);
  auto begun = std::make_unique<DeviceBroadPhase>(queue());
  begun->begin(given);
  EXPECT_TRUE(holds_in_child([&] {
    expect_refused([&] { DeviceBroadPhase refused(queue()); });
    expect_refused([&] { broad_phase->update(given); });
    expect_refused([&] { (void)broad_phase->pairs(); });
    expect_refused([&] { broad_phase->reserve(10, 10); });
    expect_refused([&] { broad_phase->set_exclusions({}); });
    expect_refused([&] { broad_phase->shrink(); });
    expect_refused([&] { begun->finish(); });
    *begun = std::move(*broad_phase);
    begun.reset();
  }));
  EXPECT_EQ(begun->finish().pair_count, 4950U);
}

/// `auto` in the middle of opening a device in its thread, and once it has opened one but not used it.
TEST(Fork, WhileADeviceIsOpenedTheChildStaysOnTheHost) {
  for (const bool is_opened : {false, true}) {
    std::atomic<bool> is_opening = false;
    std::atomic<bool> may_end = is_opened;
    const Pretender::Orders orders{.expected_seconds = 0};
    std::optional<Core<Aabb>> core(std::in_place, make_hybrid(
                                                      make_algorithm({.algorithm = "sweep-and-prune"}),
                                                      [&]() -> AlgorithmPointer {
                                                        is_opening = true;
                                                        while (!may_end) std::this_thread::yield();
                                                        return std::make_unique<Pretender>(orders);
                                                      },
                                                      0));
    const auto update = [&](std::size_t k) {
      core->move(0, k % 2 == 0 ? unit : apart(1));
      (void)core->finish();
    };
    core->add(unit, {});
    core->add(unit, {});
    for (std::size_t k = 0; !is_opening; ++k) update(k);
    EXPECT_TRUE(holds_in_child([&] {
      for (std::size_t k = 0; k < 100; ++k) update(k);
      update(0);
      EXPECT_EQ(core->pairs(), all_pairs(2));
      EXPECT_EQ(core->algorithm().device(), nullptr);
      core.reset();
    })) << is_opened;
    may_end = true;
  }
}

/// A child does not write to its parent's file, and begins files of its own.
TEST(Fork, TheChildRecordsToFilesOfItsOwn) {
  const ScopedFolder folder;
  const std::string file = (folder.path() / "run").string();
  const ScopedVariable variable("BROADCL_RECORD", file);
  const auto frames_of = [&](const std::string& name) { return cli::RecordingReader(name).frames(); };
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  broad_phase.add(unit, {.world = 3});
  (void)broad_phase.update();
  EXPECT_TRUE(holds_in_child([&] {
    for (int k = 0; k < 3; ++k) (void)broad_phase.update();
    BroadPhase other({.algorithm = "sweep-and-prune"});
    (void)other.update();
    EXPECT_EQ(frames_of(file + ".2"), 3U);
    EXPECT_EQ(cli::RecordingReader(file + ".2").next().filters.size(), 1U);
    EXPECT_EQ(frames_of(file + ".3"), 1U);
  }));
  (void)broad_phase.update();
  EXPECT_EQ(frames_of(file), 2U);
}

}  // namespace
}  // namespace broadcl::test
