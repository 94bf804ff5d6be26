#include <broadcl/broad_phase.hpp>

#include <filesystem>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "each_algorithm.hpp"
#include "environment.hpp"

/// The cost and the result of an update if little moved.
namespace broadcl::test {
namespace {

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallTheDeviceIsNotAskedIfNothingMoved) {
  BroadPhase broad_phase(config());
  EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  EXPECT_TRUE(broad_phase.profile().empty());
  for (std::uint32_t k = 0; k < 10; ++k) broad_phase.add(unit, {.body = k});
  broad_phase.add(inverted);
  const auto expect_work = [&](bool expected) {
    EXPECT_EQ(!broad_phase.profile().empty(), expected && broad_phase.device() != nullptr);
  };
  EXPECT_EQ(broad_phase.update().added.size(), 45U);
  expect_work(true);
  EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  expect_work(false);

  // None of these changes anything.
  broad_phase.move(3, unit);
  broad_phase.set_filter(3, {.body = 3});
  broad_phase.move(10, {{0, 5, 0}, {1, 4, 1}});
  broad_phase.move(4, apart(9));
  broad_phase.move(4, unit);
  broad_phase.begin();
  EXPECT_TRUE(same(broad_phase.finish(), {}, {}));
  // Box 4 went away and came back, which may count as a change; this move does not.
  broad_phase.move(3, unit);
  EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  expect_work(false);

  broad_phase.move(10, unit);
  EXPECT_EQ(broad_phase.update().added.size(), 10U);
  expect_work(true);
  EXPECT_EQ(broad_phase.pairs().size(), 55U);
}

/// So many changes that they are counted into buckets, a few per bucket; then so many in one bucket, that of
/// an object that overlaps all others, that they are sorted.
NOT_IN(rusticl, "takes long");
TEST_P(EachAlgorithm, ManyChangesAreInOrder) {
  constexpr std::uint32_t n = 10'000;
  const auto twin = [](std::uint32_t id) { return apart(id % (n / 2)); };
  BroadPhase broad_phase(config());
  for (std::uint32_t id = 0; id < n; ++id) broad_phase.add(twin(id));
  Pairs twins;
  for (std::uint32_t a = 0; a < n / 2; ++a) twins.push_back({a, a + n / 2});
  EXPECT_TRUE(same(broad_phase.update(), twins, {}));
  for (int frame = 0; frame < 3; ++frame) {
    for (std::uint32_t id = n / 2; id < n; ++id) broad_phase.move(id, apart(id));
    EXPECT_TRUE(same(broad_phase.update(), {}, twins));
    for (std::uint32_t id = n / 2; id < n; ++id) broad_phase.move(id, twin(id));
    EXPECT_TRUE(same(broad_phase.update(), twins, {}));
  }

  const std::uint32_t hub = broad_phase.add(apart(n));
  EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  Pairs of_hub;
  for (std::uint32_t a = 0; a < n; ++a) of_hub.push_back({a, hub});
  for (int frame = 0; frame < 3; ++frame) {
    broad_phase.move(hub, {{-1, -1, -1}, {2 * n, 2, 2}});
    EXPECT_TRUE(same(broad_phase.update(), of_hub, {}));
    broad_phase.move(hub, apart(n));
    EXPECT_TRUE(same(broad_phase.update(), {}, of_hub));
  }
}

/// Kernels that are first needed later are also compiled later.
NOT_IN(sanitizers, "compiles");
TEST(BruteForce, ACacheThatCannotBeWrittenCostsNothingElse) {
  const ScopedFolder folder;
  const std::filesystem::path file = folder.path() / "file";
  std::ofstream(file) << "not a folder";
  const ScopedVariable variable("BROADCL_CACHE_DIR", file.string());
  int compiled = 0;
  BroadPhase broad_phase(
      {.algorithm = "brute-force", .on_compile = [&](const Device& device, const std::string& cache_folder) {
         ++compiled;
         EXPECT_EQ(device.label(), select_device().label());
         EXPECT_EQ(cache_folder, "");
       }});
  EXPECT_EQ(compiled, 1);
  for (std::uint32_t k = 0; k < 50; ++k) broad_phase.add(apart(k));
  (void)broad_phase.update();
  broad_phase.move(3, apart(4));
  EXPECT_EQ(broad_phase.update().added.size(), 1U);
  broad_phase.set_filter(4, {.world = 1});
  EXPECT_EQ(broad_phase.update().removed.size(), 1U);
  broad_phase.set_filter(3, {.world = 1});
  EXPECT_EQ(broad_phase.update().added.size(), 1U);
  EXPECT_EQ(compiled, 1);
}

}  // namespace
}  // namespace broadcl::test
