#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "callers_queue.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "engines/boxes_outside.hpp"
#include "engines/engine.hpp"
#include "environment.hpp"
#include "failing_opencl.hpp"
#include "opencl/quirks.hpp"

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

/// Expects that no program is built while it exists.
class NothingIsBuilt {
 public:
  NothingIsBuilt() = default;
  ~NothingIsBuilt() { EXPECT_EQ(opencl_use().programs_built, before_); }
  NothingIsBuilt(const NothingIsBuilt&) = delete;
  NothingIsBuilt& operator=(const NothingIsBuilt&) = delete;
  NothingIsBuilt(NothingIsBuilt&&) = delete;
  NothingIsBuilt& operator=(NothingIsBuilt&&) = delete;

 private:
  long before_ = opencl_use().programs_built;
};

/// Few and many pairs; all boxes change, then some; then the same in two worlds, in two sets, and with
/// exclusions.
void live_on_the_host(const std::string& algorithm) {
  SCOPED_TRACE(algorithm);
  constexpr std::uint32_t n = 120;
  BroadPhase broad_phase({.algorithm = algorithm});
  const NothingIsBuilt expected;
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(k));
  const auto set_filters = [&](const auto& filter_of) {
    for (std::uint32_t id = 0; id < n; ++id) broad_phase.set_filter(id, filter_of(id));
  };
  const auto move_all_and_one = [&] {
    for (std::uint32_t id = 0; id < n; ++id) broad_phase.move(id, unit);
    (void)broad_phase.update();
    broad_phase.move(7, apart(7));
    broad_phase.begin();
    (void)broad_phase.finish();
    for (std::uint32_t id = 0; id < n; ++id) broad_phase.move(id, apart(id));
    (void)broad_phase.update();
  };
  move_all_and_one();
  set_filters([](std::uint32_t id) { return Filter{.world = id % 2}; });
  move_all_and_one();
  broad_phase.shrink();
  set_filters([](std::uint32_t id) { return id % 3 == 0 ? Filter::first_set : Filter::second_set; });
  move_all_and_one();
  broad_phase.set_exclusions(std::vector<Pair>{{1, 2}});
  move_all_and_one();
  broad_phase.remove(n - 1);
  (void)broad_phase.pairs();
  const std::vector<Aabb> boxes(std::size_t{2} * n, unit);
  (void)broad_phase.update(boxes);
  (void)broad_phase.map(std::size_t{2} * n);
  (void)broad_phase.update();
}

void live_on_the_device(const std::string& algorithm) {
  SCOPED_TRACE(algorithm);
  const CallersQueue queue;
  const cl::Buffer boxes = queue.buffer_of(std::vector<Aabb>(40, unit));
  const cl::Buffer filters = queue.buffer_of(std::vector<Filter>(40));
  const cl::Buffer added = queue.buffer_of(std::vector<Pair>(1000));
  const cl::Buffer removed = queue.buffer_of(std::vector<Pair>(1000));
  const cl::Buffer counts = queue.buffer_of(std::vector<Pair>(2));
  DeviceBroadPhase broad_phase(queue(), {.algorithm = algorithm});
  DeviceBroadPhase of_two_sets(queue(), {.algorithm = algorithm});
  const NothingIsBuilt expected;
  (void)broad_phase.update({.buffer = boxes(), .count = 40});
  for (const bool worlds : {false, true}) {
    (void)broad_phase.update({.buffer = boxes(), .count = 40, .filters = filters(), .worlds = worlds});
  }
  broad_phase.reserve(40, 780, true);
  broad_phase.enqueue({.buffer = boxes(), .count = 30, .filters = filters()},
                      {.added = added(), .removed = removed(), .capacity = 1000, .counts = counts()});
  broad_phase.set_exclusions(std::vector<Pair>{{1, 2}});
  (void)broad_phase.update(
      {.buffer = boxes(), .count = 40, .filters = filters(), .worlds = true, .ordered_worlds = 2});
  (void)broad_phase.pairs();
  broad_phase.shrink();
  (void)broad_phase.update({.buffer = boxes(), .count = 20, .offset = 4, .stride = 28});
  (void)of_two_sets.update({.buffer = boxes(), .count = 10, .second = {.buffer = boxes(), .count = 20}});
}

void live_in_double_precision() {
  BroadPhase64 broad_phase({.algorithm = "tiles"});
  const NothingIsBuilt expected;
  const Aabb64 box{{0, 0, 0}, {1, 1, 1}};
  for (int k = 0; k < 3; ++k) broad_phase.add({{0, 0, 1 + k * 1e-9}, {1, 1, 2}});
  broad_phase.add(box);
  (void)broad_phase.update();
  broad_phase.move(2, box);
  (void)broad_phase.update();
}

/// Also uses the kernels that GPUs with memory of their own need for many boxes.
void search_early() {
  const auto algorithm =
      make_device_algorithm({}, [](const opencl::Context& context) { return make_tiles(context, 3, 1); });
  const NothingIsBuilt expected;
  algorithm->reserve(2, false);
  for (Aabb& box : algorithm->boxes().first(2)) box = unit;
  for (int frame = 0; frame < 2; ++frame) {
    algorithm->begin({.boxes = algorithm->boxes().first(2), .changed = {.all = true}});
    (void)algorithm->finish();
  }
}

/// For MPI.
void find_boxes_outside() {
  const opencl::Context context(select_device(), false);
  BoxesOutside outside(context);
  const NothingIsBuilt expected;
  const cl::Buffer boxes = context.buffer(2 * sizeof(Aabb));
  context.fill(boxes, 0, 0, 12);
  outside.begin({.buffer = boxes, .count = 2, .stride = 6}, cl::Buffer(), apart(1));
  EXPECT_EQ(outside.finish(), 2U);
}

/// The list gives the programs that are built with other compilers (scripts/check-compilers).
void expect_listed_programs(const std::string& profile) {
  const ScopedFolder folder;
  const ScopedVariable cache("BROADCL_CACHE_DIR", folder.path().string());
  const ScopedVariable tuning("BROADCL_TUNING", profile);
  const ScopedVariable device("BROADCL_DEVICE", select_device().id());  // so that `auto` opens it
  for (const char* algorithm : {"brute-force", "tiles", "auto"}) {
    live_on_the_host(algorithm);
    live_on_the_device(algorithm);
  }
  live_on_the_host("gpu-bf");
  live_in_double_precision();
  search_early();
  find_boxes_outside();
  EXPECT_THAT(cached_programs(folder.path()), ::testing::ContainerEq(listed_programs(profile)));
}

class ProgramList : public ::testing::TestWithParam<std::string> {};

TEST_P(ProgramList, ThatAreBuiltAreThoseOfTheList) {
  expect_listed_programs(GetParam());
}

TEST(LongProgramList, ForWavesOf64AreThoseOfTheList) {
  expect_listed_programs("gpu64");
}

TEST(ProgramsBuilt, ByObjectsThatShareADeviceAreBuiltOnce) {
  const ScopedFolder folder;
  const ScopedVariable cache("BROADCL_CACHE_DIR", folder.path().string());
  const Config config{.device = select_device().id(), .algorithm = "tiles"};
  const long before = opencl_use().programs_built;
  const BroadPhase first(config);
  const BroadPhase second(config);
  EXPECT_EQ(opencl_use().programs_built - before, static_cast<long>(cached_programs(folder.path()).size()));
}

TEST(ProgramsBuilt, BySeveralThreadsAreBuiltOneAtATimeIfTheDriverNeedsThat) {
  if (!opencl::quirks_of(select_device()).builds_one_at_a_time) GTEST_SKIP() << "the driver does not";
  const ScopedFolder folder;
  const ScopedVariable cache("BROADCL_CACHE_DIR", folder.path().string());
  std::vector<std::thread> threads;
  for (const char* algorithm : {"brute-force", "tiles", "gpu-bf"}) {
    threads.emplace_back([=] { const BroadPhase opened({.algorithm = algorithm}); });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(opencl_use().most_built_at_once, 1);
}

TEST(ProgramsBuilt, ByASingleSearchAreThoseOfTiles) {
  using ::testing::Each;
  using ::testing::Not;
  using ::testing::StartsWith;
  const ScopedFolder folder;
  const ScopedVariable cache("BROADCL_CACHE_DIR", folder.path().string());
  const std::vector<Aabb> boxes(5, unit);
  EXPECT_EQ(overlapping_pairs(boxes, {}, {.device = select_device().id(), .algorithm = "auto"}).size(), 10U);
  EXPECT_THAT(cached_programs(folder.path()), Each(Not(StartsWith("brute_force.cl"))));
}

INSTANTIATE_TEST_SUITE_P(Tuned, ProgramList, ::testing::Values("gpu", "cpu"),
                         [](const auto& test) { return "for_" + test.param; });

}  // namespace
}  // namespace broadcl::test
