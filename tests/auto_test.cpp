#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "algorithms/algorithm.hpp"
#include "algorithms/calibration.hpp"
#include "algorithms/engine.hpp"
#include "algorithms/pair_finder.hpp"
#include "each_algorithm.hpp"
#include "environment.hpp"
#include "expect_error.hpp"
#include "opencl/context.hpp"
#include "opencl/opened_device.hpp"
#include "packed_box.hpp"
#include "scenes/generators.hpp"

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

TEST(Auto, AStageTellsWhichIsAsked) {
  constexpr std::uint32_t n = 200'000;
  if (is_slow_device()) GTEST_SKIP() << "takes long on this device";
  if (select_device().type != DeviceType::cpu) GTEST_SKIP() << "a GPU is opened later";
  BroadPhase broad_phase;
  EXPECT_EQ(broad_phase.algorithm().name, "auto");
  // With this many objects, not even the first frame tests all pairs.
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(k));
  (void)broad_phase.update();
  EXPECT_TRUE(has_stage(broad_phase.profile(), "tiles"));
  EXPECT_TRUE(has_stage(broad_phase.profile(), "build"));
  EXPECT_FALSE(has_stage(broad_phase.profile(), "brute-force"));
  // After few changes, either may be chosen.
  for (std::uint32_t k = 1; k < 5; ++k) {
    broad_phase.move(7 * k, apart(8));
    (void)broad_phase.update();
    const bool tiles = has_stage(broad_phase.profile(), "tiles");
    EXPECT_NE(has_stage(broad_phase.profile(), "brute-force"), tiles);
    EXPECT_EQ(has_stage(broad_phase.profile(), "build"), tiles);
  }
}

/// A GPU that needs the launch parameters of CPUs must not seem to take no time: until then, the host does
/// the updates.
NOT_IN(sanitizers, "measures time");
TEST(Auto, KnowsTheCostOnAGpuWithTheProfileOfCpus) {
  Device device = select_device();
  device.type = DeviceType::gpu;
  opencl::forget_opened_devices();  // which are described otherwise
  {
    const opencl::Context context(device, false, {}, opencl::Tuning::cpu);
    EXPECT_GT(make_auto(context)->expected_seconds(100, 100), 0);
  }
  opencl::forget_opened_devices();
}

/// Every box overlaps all others, so testing all pairs is no worse: `tiles` is given up as soon as its work
/// is known.
NOT_IN(gpu_profile | rusticl | sanitizers, "takes long");
TEST(Auto, WhatTilesCountsDecides) {
  constexpr std::uint32_t n = 10'000;
  if (select_device().type != DeviceType::cpu) GTEST_SKIP() << "on a GPU, both take equally long";
  BroadPhase broad_phase;
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(unit, {.body = 1});
  for (int frame = 0; frame < 3; ++frame) {
    (void)broad_phase.map(n);
    (void)broad_phase.update();
  }
  EXPECT_TRUE(has_stage(broad_phase.profile(), "brute-force"));
}

/// Uses the two finders in turn, one per search.
class Turns final : public PairFinder {
 public:
  explicit Turns(const opencl::Context& context) : finders_{make_brute_force(context), make_tiles(context)} {}

  void build(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    turn_ = 1 - turn_;
    finders_.at(turn_)->build(search, sink, profiler);
  }
  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    finders_.at(turn_)->find(search, sink, profiler);
  }
  [[nodiscard]] double expected_work(const Search& /*search*/, const PairDelta& /*sink*/) override {
    return 0;
  }

 private:
  std::array<std::unique_ptr<PairFinder>, 2> finders_;
  std::size_t turn_ = 0;
};

std::unique_ptr<PairFinder> make_turns(const opencl::Context& context) {
  return std::make_unique<Turns>(context);
}

/// An engine and the oracle with the same input.
class EngineAndOracle {
 public:
  explicit EngineAndOracle(std::size_t slots)
      : engines_{make_device_algorithm({}, make_turns), make_algorithm({.algorithm = "oracle"})} {
    for (const auto& engine : engines_) engine->reserve(slots, false);
  }

  void write(std::uint32_t slot, const Aabb& box) {
    for (const auto& engine : engines_) engine->boxes()[slot] = box;
  }

  [[nodiscard]] ::testing::AssertionResult agree(const Changes& changes) {
    for (const auto& engine : engines_) engine->begin(changes);
    const Delta expected = engines_[1]->finish();
    ::testing::AssertionResult result = same(engines_[0]->finish(), expected.added, expected.removed);
    return result ? same("pairs", engines_[0]->pairs(), engines_[1]->pairs()) : result;
  }

  [[nodiscard]] std::span<const Stage> profile() const { return engines_[0]->profile(); }

 private:
  std::array<AlgorithmPointer, 2> engines_;
};

/// The result does not depend on which finder is used. All boxes move or only a few, some are replaced or
/// removed, and their number grows and shrinks.
TEST(Auto, FindersThatTakeTurnsFindWhatTheOracleFinds) {
  for (const std::uint32_t seed : {1U, 2U, 3U}) {
    std::mt19937 random(seed);
    constexpr std::uint32_t most = 1500;
    scenes::MovingBoxes boxes(most, scenes::MovingBoxes::Sizes::mixed, seed);
    EngineAndOracle both(most);
    std::uint32_t slots = 0;
    for (int frame = 0; frame < 40; ++frame) {
      for (int k = 0; k < 5; ++k) boxes.advance();
      const bool all = frame == 0 || random() % 2 == 0;
      std::vector<std::uint32_t> changed;
      std::vector<std::uint32_t> recycled;
      if (all) {
        if (random() % 2 == 0) slots = most / 3 + static_cast<std::uint32_t>(random() % (most - most / 3));
        for (std::uint32_t slot = 0; slot < slots; ++slot) both.write(slot, boxes.boxes()[slot]);
      } else {
        for (std::uint32_t slot = 0; slot < slots; slot += 1 + static_cast<std::uint32_t>(random() % 200)) {
          changed.push_back(slot);
          const bool goes = random() % 8 == 0;
          both.write(slot, goes ? packed_empty() : boxes.boxes()[slot]);
          if (goes || random() % 4 == 0) recycled.push_back(slot);
        }
      }
      ASSERT_TRUE(both.agree({.slots = slots, .changed = changed, .all = all, .recycled = recycled}))
          << "seed " << seed << ", frame " << frame;
    }
  }
}

/// If `tiles` is used only every second frame, it cannot watch how its order ages. It still sorts again, but
/// not each time.
TEST(Auto, TilesThatTakeTurnsSortOnceInAWhile) {
  constexpr std::uint32_t n = 500;
  scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::uniform);
  EngineAndOracle both(n);
  int searches = 0;
  int sorts = 0;
  for (int frame = 0; frame < 40; ++frame) {
    boxes.advance();
    for (std::uint32_t slot = 0; slot < n; ++slot) both.write(slot, boxes.boxes()[slot]);
    ASSERT_TRUE(both.agree({.slots = n, .changed = {}, .all = true, .recycled = {}}));
    std::string_view last;
    for (const Stage& stage : both.profile()) {
      if (stage.name == "build") {
        ++searches;
        if (last == "sort") ++sorts;
      }
      last = stage.name;
    }
  }
  EXPECT_EQ(searches, 20);
  EXPECT_EQ(sorts, 4);
}

}  // namespace
}  // namespace broadcl::test
