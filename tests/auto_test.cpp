#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <utility>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "core/core.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "engines/engine.hpp"
#include "environment.hpp"
#include "expect_error.hpp"
#include "failing_opencl.hpp"
#include "finder_variants.hpp"
#include "finders/calibration.hpp"
#include "opencl/context.hpp"
#include "scenes/generators.hpp"
#include "twins.hpp"

namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

SUITE_NOT_IN(Calibration, sanitizers, "measures time");

constexpr std::array finders{&make_brute_force, static_cast<MakePairFinder>(&make_tiles)};

std::array<CostModel, 2> calibrated_in(const std::filesystem::path& folder) {
  const ScopedVariable variable("BROADCL_CACHE_DIR", folder.string());
  return calibrate(opencl::Context(select_device(), false), finders);
}

/// A new measurement would differ, if only by nanoseconds.
bool are_same(const std::array<CostModel, 2>& s, const std::array<CostModel, 2>& t) {
  return s[0].frame == t[0].frame && s[1].frame == t[1].frame;
}

TEST(Calibration, NoTermOfAModelIsNegative) {
  const ScopedFolder folder;
  for (const CostModel& model : calibrated_in(folder.path())) {
    EXPECT_GT(model.frame, 0);
    EXPECT_GT(model.slot, 0);
    EXPECT_GT(model.work[0], 0);
    EXPECT_GT(model.work[1], 0);
    EXPECT_LT(model.seconds(128, true, 128), 10);
  }
}

TEST(Calibration, IsMeasuredOnceAndStored) {
  const ScopedFolder folder;
  const auto first = calibrated_in(folder.path() / "a");
  EXPECT_TRUE(are_same(calibrated_in(folder.path() / "a"), first));
  EXPECT_FALSE(are_same(calibrated_in(folder.path() / "b"), first));
}

TEST(Calibration, WhatWasDamagedIsMeasuredAgain) {
  const ScopedFolder folder;
  const auto first = calibrated_in(folder.path());
  for (const auto& file : std::filesystem::directory_iterator(folder.path())) {
    std::filesystem::resize_file(file, std::filesystem::file_size(file) - 1);
  }
  const auto second = calibrated_in(folder.path());
  EXPECT_FALSE(are_same(second, first));
  EXPECT_TRUE(are_same(calibrated_in(folder.path()), second));
}

TEST(Calibration, LeavesNoMemoryBehind) {
  const ScopedFolder folder;
  const ScopedVariable variable("BROADCL_CACHE_DIR", folder.path().string());
  const opencl::Context context(select_device(), false);
  (void)calibrate(context, finders);
  EXPECT_EQ(context.memory().device_peak, 0U);
}

class DeviceFor : public ::testing::Test {
 protected:
  const Device best_ = select_device();
  const ScopedVariable none_{"BROADCL_DEVICE", ""};
};

TEST_F(DeviceFor, NothingIsTheHostAtFirst) {
  EXPECT_FALSE(device_for({}).has_value());
  BroadPhase broad_phase;
  EXPECT_EQ(broad_phase.algorithm().name, "auto");
  EXPECT_EQ(broad_phase.device(), nullptr);
  for (std::uint32_t k = 0; k < 10; ++k) broad_phase.add(unit);
  EXPECT_EQ(broad_phase.update().added.size(), 45U);
}

TEST_F(DeviceFor, ANameIsThatDevice) {
  const auto id_of = [](const std::optional<Device>& device) { return device ? device->id() : "none"; };
  // A GPU is opened later.
  const std::string at_first = best_.type == DeviceType::cpu ? best_.id() : "none";
  EXPECT_EQ(id_of(device_for({.device = best_.id()})), at_first);
  EXPECT_EQ(id_of(device_for({.device = best_.id(), .algorithm = "sweep-and-prune"})), "none");
  EXPECT_EQ(id_of(device_for({.algorithm = "tiles"})), select_device().id());
  {
    const ScopedVariable variable("BROADCL_DEVICE", best_.id());
    EXPECT_EQ(id_of(device_for({})), at_first);
  }
  EXPECT_THAT(error_of([] { (void)device_for({.device = "abacus"}); }), HasSubstr("'abacus'"));
  EXPECT_THAT(error_of([] { (void)device_for({.algorithm = "abacus"}); }), HasSubstr("'abacus'"));
}

TEST(Auto, TestsAllPairsOnlyIfThatIsTheLeastWork) {
  constexpr std::uint32_t n = 200'000;
  if (is_slow_device()) GTEST_SKIP() << "takes long on this device";
  if (select_device().type != DeviceType::cpu) GTEST_SKIP() << "a GPU is opened later";
  BroadPhase broad_phase;
  const long before = launches_of("brute_force");
  const auto update = [&] {
    const long tiles = launches_of("tiles_search");
    (void)broad_phase.update();
    return launches_of("tiles_search") > tiles;
  };
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(k));
  EXPECT_TRUE(update());
  EXPECT_EQ(launches_of("brute_force"), before);
  // After few changes, either may be chosen.
  for (std::uint32_t k = 1; k < 5; ++k) {
    broad_phase.move(7 * k, apart(8));
    const long all = launches_of("brute_force");
    const bool tiles = update();
    EXPECT_NE(launches_of("brute_force") > all, tiles);
  }
}

/// A GPU that needs the launch parameters of CPUs must not seem to take no time: until then, the host does
/// the updates.
NOT_IN(sanitizers, "measures time");
TEST(Auto, KnowsTheCostOnAGpuWithTheProfileOfCpus) {
  Device device = select_device();
  device.type = DeviceType::gpu;
  const opencl::Context context(device, false, {}, opencl::Tuning::cpu);
  EXPECT_GT(make_auto(context)->expected_seconds(100, 100), 0);
}

/// Every box overlaps all others, so testing all pairs is no worse: `tiles` is given up as soon as its work
/// is known.
NOT_IN(gpu_profile | rusticl | sanitizers, "takes long");
TEST(Auto, WhatTilesCountsDecides) {
  constexpr std::uint32_t n = 10'000;
  if (select_device().type != DeviceType::cpu) GTEST_SKIP() << "on a GPU, both take equally long";
  BroadPhase broad_phase;
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(unit, {.body = 1});
  const long before = launches_of("brute_force");
  for (int frame = 0; frame < 3; ++frame) {
    (void)broad_phase.map(n);
    (void)broad_phase.update();
  }
  EXPECT_GT(launches_of("brute_force"), before);
}

/// If `tiles` is used only every second frame, it cannot watch how its order ages. It still sorts again, but
/// not each time.
TEST(Auto, TilesThatTakeTurnsSortOnceInAWhile) {
  constexpr std::uint32_t n = 500;
  scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::uniform);
  Twins<Core> twins(std::in_place, NoTrouble(), false, make_device_algorithm({}, make_turns));
  const long searches = launches_of("tiles_search");
  const long sorts = launches_of("tiles_keys");
  for (int frame = 0; frame < 40; ++frame) {
    boxes.advance();
    twins.map(n, [&](std::span<Aabb> mapped) { std::ranges::copy(boxes.boxes(), mapped.begin()); });
    ASSERT_TRUE(twins.agree());
  }
  EXPECT_EQ(launches_of("tiles_search") - searches, 20);
  EXPECT_EQ(launches_of("tiles_keys") - sorts, 4);
}

}  // namespace
}  // namespace broadcl::test
