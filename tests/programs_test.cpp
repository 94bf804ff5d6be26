#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "callers_queue.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "engines/boxes_outside.hpp"
#include "engines/engine.hpp"
#include "environment.hpp"
#include "failing_opencl.hpp"

namespace broadcl::test {
namespace {

/// File names, with options.
using Programs = std::set<std::string>;

/// The programs that kernels/programs.txt lists for a tuning.
Programs listed_programs(const std::string& profile) {
  Programs programs;
  std::ifstream file(BROADCL_KERNEL_FOLDER "/programs.txt");
  const std::string group = "-DGROUP=32";
  const bool has_waves_of_64 = profile == "gpu64";
  for (std::string line; std::getline(file, line);) {
    const std::size_t at = line.find(group);
    if (has_waves_of_64 && at != std::string::npos) line.replace(at, group.size(), "-DGROUP=64");
    for (const std::string& prefix : {(has_waves_of_64 ? "gpu" : profile) + " ", std::string("both ")}) {
      if (line.starts_with(prefix)) programs.insert(line.substr(prefix.size()));
    }
  }
  return programs;
}

std::string_view between(std::string_view text, std::string_view before, std::string_view after) {
  const std::size_t begin = text.find(before);
  if (begin == std::string_view::npos) return {};
  text.remove_prefix(begin + before.size());
  return text.substr(0, text.find(after));
}

/// The programs in a cache: their keys contain the options and the source.
Programs cached_programs(const std::filesystem::path& folder) {
  Programs programs;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    std::ifstream file(entry.path(), std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    const std::string_view options = between(text, "-cl-std=CL1.2 ", {"\0", 1});
    const std::string_view name = between(text, "#line 1 \"", "\"");
    if (name.empty()) continue;  // what was found out about the device
    programs.insert(std::string(name) + (options.empty() ? "" : " ") + std::string(options));
  }
  return programs;
}

/// All boxes change, then some; then the same in two worlds.
void live_on_the_host(const std::string& algorithm) {
  BroadPhase broad_phase({.algorithm = algorithm});
  for (std::uint32_t k = 0; k < 40; ++k) broad_phase.add(apart(k));
  for (const std::uint32_t worlds : {1U, 2U}) {
    for (std::uint32_t id = 0; id < 40; ++id) broad_phase.set_filter(id, {.world = id % worlds});
    for (std::uint32_t id = 0; id < 40; ++id) broad_phase.move(id, unit);
    (void)broad_phase.update();
    broad_phase.move(7, apart(7));
    (void)broad_phase.update();
  }
}

void live_on_the_device(const std::string& algorithm) {
  const CallersQueue queue;
  DeviceBroadPhase broad_phase(queue(), {.algorithm = algorithm});
  const cl::Buffer boxes = queue.buffer_of(std::vector<Aabb>(40, unit));
  const cl::Buffer filters = queue.buffer_of(std::vector<Filter>(40));
  (void)broad_phase.update({.buffer = boxes(), .count = 40});
  for (const bool worlds : {false, true}) {
    (void)broad_phase.update({.buffer = boxes(), .count = 40, .filters = filters(), .worlds = worlds});
  }
}

/// Searches with one program more, which GPUs with memory of their own need for many boxes.
void search_early() {
  const auto algorithm =
      make_device_algorithm({}, [](const opencl::Context& context) { return make_tiles(context, 1.25, 1); });
  algorithm->reserve(2, false);
  for (Aabb& box : algorithm->boxes().first(2)) box = unit;
  for (int frame = 0; frame < 2; ++frame) {
    algorithm->begin({.boxes = algorithm->boxes().first(2), .all = true});
    (void)algorithm->finish();
  }
}

/// The list gives the programs that are built with other compilers (scripts/check-compilers).
void expect_listed_programs(const std::string& profile) {
  const ScopedFolder folder;
  const ScopedVariable cache("BROADCL_CACHE_DIR", folder.path().string());
  const ScopedVariable tuning("BROADCL_TUNING", profile);
  for (const char* algorithm : {"brute-force", "tiles"}) {
    live_on_the_host(algorithm);
    live_on_the_device(algorithm);
  }
  live_on_the_host("gpu-bf");
  const opencl::Context context(select_device(), false);
  const BoxesOutside for_mpi(context);
  if (profile != "cpu") search_early();
  EXPECT_THAT(cached_programs(folder.path()), ::testing::ContainerEq(listed_programs(profile)));
}

class ProgramList : public ::testing::TestWithParam<std::string> {};

TEST_P(ProgramList, ThatAreBuiltAreThoseOfTheList) {
  expect_listed_programs(GetParam());
}

TEST(LongProgramList, ForWavesOf64AreThoseOfTheList) {
  expect_listed_programs("gpu64");
}

/// Compiling takes seconds on a CPU.
TEST(ProgramsBuilt, ByAutoGrowWithTheNumberOfObjects) {
  using ::testing::Contains;
  using ::testing::Each;
  using ::testing::Not;
  using ::testing::StartsWith;
  const ScopedFolder folder;
  const ScopedVariable cache("BROADCL_CACHE_DIR", folder.path().string());
  const ScopedVariable tuning("BROADCL_TUNING", "cpu");
  const Config config{.device = select_device().id(), .algorithm = "auto"};
  // (`auto` would use the host if the device were a GPU.)
  if (select_device().type != DeviceType::cpu) GTEST_SKIP() << "the device is not a CPU";
  const long before = opencl_use().programs_built;
  BroadPhase broad_phase(config);
  for (std::uint32_t k = 0; k < 300; ++k) broad_phase.add(apart(k));
  (void)broad_phase.update();
  EXPECT_THAT(cached_programs(folder.path()), Contains(StartsWith("brute_force.cl")));
  EXPECT_THAT(cached_programs(folder.path()), Each(Not(StartsWith("tiles"))));
  for (std::uint32_t k = 300; k < 100'000; ++k) broad_phase.add(apart(k));
  const auto programs = cached_programs(folder.path());
  EXPECT_THAT(programs, Contains(StartsWith("tiles.cl")));
  EXPECT_EQ(opencl_use().programs_built - before, static_cast<long>(programs.size())) << "each once";
}

TEST(ProgramsBuilt, ByASingleSearchAreThoseOfTiles) {
  using ::testing::Each;
  using ::testing::Not;
  using ::testing::StartsWith;
  const ScopedFolder folder;
  const ScopedVariable cache("BROADCL_CACHE_DIR", folder.path().string());
  const std::vector<Aabb> boxes(5, unit);
  EXPECT_EQ(overlapping_pairs(boxes, {.device = select_device().id(), .algorithm = "auto"}).size(), 10U);
  EXPECT_THAT(cached_programs(folder.path()), Each(Not(StartsWith("brute_force.cl"))));
}

INSTANTIATE_TEST_SUITE_P(Tuned, ProgramList, ::testing::Values("gpu", "cpu"),
                         [](const auto& test) { return "for_" + test.param; });

}  // namespace
}  // namespace broadcl::test
