#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "algorithms/algorithm.hpp"
#include "algorithms/calibration.hpp"
#include "algorithms/chooser.hpp"
#include "algorithms/delta_engine.hpp"
#include "algorithms/pair_finder.hpp"
#include "each_algorithm.hpp"
#include "environment.hpp"
#include "expect_error.hpp"
#include "opencl/context.hpp"
#include "scenes/generators.hpp"

namespace broadcl::test {
namespace {

SUITE_NOT_IN(Calibration, sanitizers, "measures time");

// Choosing, with costs that are told and not measured.

/// All pairs, or what is linear: they cost the same at 100,000 tests a second and 1,000 slots.
constexpr std::array models{CostModel{.frame = 0, .slot = 0, .test = 1e-8},
                            CostModel{.frame = 0, .slot = 5e-6, .test = 0}};

constexpr Work all_of(std::size_t slots) {
  return {.slots = slots, .changed = slots, .all = true};
}

/// Plays frames of the same work and tells how often each was asked.
class Player {
 public:
  using Cost = std::function<double(std::size_t chosen, std::size_t frame)>;

  void play(const Work& work, std::size_t frames, const Cost& cost) {
    asked_ = {};
    for (std::size_t frame = 0; frame < frames; ++frame) {
      const std::size_t chosen = chooser_.choose(work);
      ++asked_.at(chosen);
      chooser_.learn(cost(chosen, frame));
    }
  }

  [[nodiscard]] std::size_t asked(std::size_t which) const { return asked_.at(which); }

 private:
  Chooser chooser_{models};
  std::array<std::size_t, 2> asked_{};
};

TEST(Chooser, TheFirstGuessIsThatOfTheModels) {
  Chooser chooser(models);
  EXPECT_EQ(chooser.choose(all_of(500)), 0U);
  EXPECT_EQ(chooser.choose(all_of(2000)), 1U);
  EXPECT_EQ(chooser.choose({.slots = 2000, .changed = 10, .all = false}), 0U);
}

TEST(Chooser, WithoutMeasurementsNothingIsTried) {
  Chooser chooser(models);
  for (int frame = 0; frame < 10'000; ++frame) ASSERT_EQ(chooser.choose(all_of(900)), 0U);
}

/// Whatever frames cost, and whatever a frame costs that was not expected to.
TEST(Chooser, TheHopelessOneIsNeverAsked) {
  Player player;
  for (const std::size_t slots : {10'000U, 1'000'000U, 10'000U}) {
    player.play(all_of(slots), 5000,
                [](std::size_t, std::size_t frame) { return frame % 7 == 0 ? 100.0 : 1.0; });
    EXPECT_EQ(player.asked(0), 0U);
  }
  player.play(all_of(100), 5000, [](std::size_t, std::size_t) { return 1.0; });
  EXPECT_EQ(player.asked(1), 0U);
}

/// Models that are wrong by any factor; first frames after a change that take three times as long; and one
/// frame in a hundred that something else makes twenty times as long, which is left out of the sums.
TEST(Chooser, CostsLittleMoreThanTheBetterOne) {
  for (const std::size_t slots : {300U, 900U, 1100U, 3500U}) {
    for (const double second : {0.1, 0.3, 0.8, 1.0, 1.3, 3.0, 10.0}) {
      std::mt19937 random;  // NOLINT(bugprone-random-generator-seed): the same frames for all
      std::size_t last = 2;
      double best = 0;
      double total = 0;
      Player player;
      player.play(all_of(slots), 4096, [&](std::size_t chosen, std::size_t frame) {
        const double noise = 1 + static_cast<double>(frame % 5) / 50;
        const double cold = std::exchange(last, chosen) == chosen ? 1 : 3;
        const double seconds = noise * cold * (chosen == 0 ? 1 : second);
        best += noise * std::min(1.0, second);
        total += seconds;
        return random() % 100 == 0 ? 20 * seconds : seconds;
      });
      EXPECT_LT(total, 1.2 * best) << slots << " slots, the second costs " << second;
    }
  }
}

/// However few the frames are: what costs far more is tried in one frame, and the later the more the models
/// expect of it.
TEST(Chooser, AFirstTrialTakesASmallPartOfTheTime) {
  for (const std::size_t slots : {300U, 500U, 900U, 1300U, 2000U, 3500U}) {
    const std::size_t best = slots < 1000 ? 0 : 1;
    const double expected = models[1 - best].seconds(all_of(slots)) / models[best].seconds(all_of(slots));
    for (const double really : {1.0, 2.0, 8.0, 30.0}) {
      Chooser chooser(models);
      double total = 0;
      for (std::size_t frame = 1; frame <= 256; ++frame) {
        const double seconds = chooser.choose(all_of(slots)) == best ? 1 : really;
        total += seconds;
        chooser.learn(seconds);
        EXPECT_LE(total, 1.1 * static_cast<double>(frame) + 3 * std::max(1.0, really - expected))
            << slots << " slots, really " << really << ", frame " << frame;
      }
    }
  }
}

TEST(Chooser, FollowsAChangeOfTheScene) {
  Player player;
  const auto cost = [](double first, double second) {
    return [=](std::size_t chosen, std::size_t) { return chosen == 0 ? first : second; };
  };
  player.play(all_of(1000), 3000, cost(1, 3));
  EXPECT_GT(player.asked(0), 2900U);
  // What is asked has become dearer: no trial is needed.
  player.play(all_of(1000), 100, cost(5, 3));
  EXPECT_GT(player.asked(1), 95U);
  // What is not asked has become cheaper.
  player.play(all_of(1000), 1100, cost(1, 3));
  player.play(all_of(1000), 1000, cost(1, 3));
  EXPECT_GT(player.asked(0), 950U);
}

TEST(Chooser, SituationsThatTakeTurnsAreLearnedEach) {
  Chooser chooser(models);
  const Work few{.slots = 1000, .changed = 400, .all = false};
  std::array<std::array<std::size_t, 2>, 2> asked{};
  for (std::size_t frame = 0; frame < 2000; ++frame) {
    const bool all = frame % 2 == 0;
    const std::size_t chosen = chooser.choose(all ? all_of(1000) : few);
    ++asked.at(all ? 1 : 0).at(chosen);
    chooser.learn(chosen == (all ? 1U : 0U) ? 1 : 2);
  }
  EXPECT_GT(asked[1][1], 900U);
  EXPECT_GT(asked[0][0], 900U);
}

// Measuring a device.

/// Models that are far from right.
constexpr std::array contestants{Contestant{make_brute_force, {.frame = 1, .slot = 2, .test = 3}},
                                 Contestant{make_tiles, {.frame = 4, .slot = 5, .change = 6, .test = 7}}};

std::array<Calibration, 2> calibrated_in(const std::filesystem::path& folder) {
  const ScopedVariable variable("BROADCL_CACHE_DIR", folder);
  return calibrate(opencl::Context(select_device(), false), contestants);
}

/// What is measured differs each time, if only by nanoseconds.
bool are_same(const std::array<Calibration, 2>& s, const std::array<Calibration, 2>& t) {
  return s[0].model.frame == t[0].model.frame && s[1].model.frame == t[1].model.frame &&
         s[0].grain == t[0].grain && s[1].grain == t[1].grain;
}

TEST(Calibration, ModelsAreBroughtToWhatSearchesCost) {
  const ScopedFolder folder;
  const std::array<Calibration, 2> calibrated = calibrated_in(folder.path());
  for (std::size_t k = 0; k < calibrated.size(); ++k) {
    const CostModel& before = contestants.at(k).model;
    const CostModel& after = calibrated.at(k).model;
    EXPECT_GT(after.frame, 0);
    EXPECT_LT(after.seconds(all_of(128)), 10) << "seconds, and the model said thousands";
    EXPECT_GT(after.slot, 0);
    EXPECT_GT(after.test, 0);
    EXPECT_NEAR(after.change / after.test, before.change / before.test, 1e-6);
  }
}

TEST(Calibration, IsMeasuredOnceAndKept) {
  const ScopedFolder folder;
  const auto first = calibrated_in(folder.path() / "a");
  EXPECT_TRUE(are_same(calibrated_in(folder.path() / "a"), first));
  EXPECT_FALSE(are_same(calibrated_in(folder.path() / "b"), first));
}

TEST(Calibration, WhatWasDamagedIsMeasuredAnew) {
  const ScopedFolder folder;
  const auto first = calibrated_in(folder.path());
  for (const auto& file : std::filesystem::directory_iterator(folder.path())) {
    std::filesystem::resize_file(file, std::filesystem::file_size(file) - 1);
  }
  const auto second = calibrated_in(folder.path());
  EXPECT_FALSE(are_same(second, first));
  EXPECT_TRUE(are_same(calibrated_in(folder.path()), second));
}

/// Takes half as long with the grain that suits it.
template <int suits>
class Grained final : public PairFinder {
 public:
  void set_grain(double grain) override { grain_ = grain; }
  [[nodiscard]] std::size_t pieces(const Search& /*search*/) const override {
    return static_cast<std::size_t>(4 * grain_);
  }
  void find(const Search& /*search*/, const PairDelta& /*sink*/, opencl::Profiler& /*profiler*/) override {
    std::this_thread::sleep_for(std::chrono::milliseconds(grain_ == suits ? 2 : 4));
  }

 private:
  double grain_ = 1;
};

template <int suits>
constexpr Contestant grained{
    [](const opencl::Context&) -> std::unique_ptr<PairFinder> { return std::make_unique<Grained<suits>>(); },
    {.frame = 1, .slot = suits, .test = 1}};  // another model, lest what was kept of another one counts

TEST(Calibration, ChoosesTheGrainThatSuits) {
  const ScopedFolder folder;
  const ScopedVariable variable("BROADCL_CACHE_DIR", folder.path());
  const opencl::Context context(select_device(), false);
  const auto calibrated = calibrate(context, {grained<1>, grained<4>});
  EXPECT_EQ(calibrated[0].grain, 1);
  EXPECT_EQ(calibrated[1].grain, 4);
  // None suits: the usual one, since no other is clearly better.
  EXPECT_EQ(calibrate(context, {grained<4>, grained<3>})[1].grain, 1);
}

TEST(Calibration, TheEnvironmentOverridesTheGrain) {
  const ScopedFolder folder;
  const ScopedVariable variable("BROADCL_GRAIN", "0.5");
  const auto calibrated = calibrated_in(folder.path());
  EXPECT_EQ(calibrated[0].grain, 0.5);
  EXPECT_EQ(calibrated[1].grain, 0.5);
}

TEST(Grain, WhatIsNoNumberOrOutOfBoundsIsAnError) {
  for (const std::string grain : {"x", "1x", "0", "-1", "nan", "101"}) {
    const ScopedVariable variable("BROADCL_GRAIN", grain);
    EXPECT_EQ(error_of([] { const BroadPhase broad_phase({.algorithm = "tiles"}); }),
              "BROADCL_GRAIN is '" + grain + "'; set it to a number from 0.01 to 100");
  }
}

TEST(Grain, ChangesNothingOfWhatIsFound) {
  for (const std::uint32_t n : {2U, 100U, 3000U}) {
    const scenes::MovingBoxes scene(n, scenes::MovingBoxes::Sizes::mixed);
    const std::vector<Pair> expected = overlapping_pairs(scene.boxes(), {.algorithm = "sweep-and-prune"});
    for (const std::string grain : {"0.01", "0.25", "4", "100"}) {
      const ScopedVariable variable("BROADCL_GRAIN", grain);
      for (const std::string algorithm : {"brute-force", "tiles"}) {
        EXPECT_TRUE(overlapping_pairs(scene.boxes(), {.algorithm = algorithm}) == expected)
            << algorithm << ", grain " << grain << ", " << n << " boxes";
      }
    }
  }
}

TEST(Calibration, LeavesNoMemoryBehind) {
  const ScopedFolder folder;
  const ScopedVariable variable("BROADCL_CACHE_DIR", folder.path());
  const opencl::Context context(select_device(), false);
  (void)calibrate(context, contestants);
  EXPECT_EQ(context.memory().device_peak, 0U);
}

// On the device.

bool has_stage(std::span<const Stage> stages, std::string_view name) {
  return std::ranges::any_of(stages, [&](const Stage& stage) { return stage.name == name; });
}

TEST(Auto, AStageTellsWhichIsAsked) {
  constexpr std::uint32_t n = 200'000;
  if (is_slow_device()) GTEST_SKIP() << "takes long on this device";
  BroadPhase broad_phase;
  EXPECT_EQ(broad_phase.algorithm().name, "auto");
  // Not even the first frame of so many tests all pairs.
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(k));
  (void)broad_phase.update();
  EXPECT_TRUE(has_stage(broad_phase.profile(), "tiles"));
  EXPECT_TRUE(has_stage(broad_phase.profile(), "build"));
  EXPECT_FALSE(has_stage(broad_phase.profile(), "brute-force"));
  // Few changes may be for either.
  for (std::uint32_t k = 1; k < 5; ++k) {
    broad_phase.move(7 * k, apart(8));
    (void)broad_phase.update();
    const bool tiles = has_stage(broad_phase.profile(), "tiles");
    EXPECT_NE(has_stage(broad_phase.profile(), "brute-force"), tiles);
    EXPECT_EQ(has_stage(broad_phase.profile(), "build"), tiles);
  }
}

TEST(Auto, AStageTellsTheGrain) {
  for (const auto& [grain, name] : {std::pair("0.25", "grain 1/4"), std::pair("3", "BROADCL_GRAIN")}) {
    const ScopedVariable variable("BROADCL_GRAIN", grain);
    BroadPhase broad_phase;
    broad_phase.add(apart(0));
    (void)broad_phase.update();
    EXPECT_TRUE(has_stage(broad_phase.profile(), name)) << grain;
  }
}

/// Asks both finders in turn, one a search.
class Turns final : public PairFinder {
 public:
  explicit Turns(const opencl::Context& context) : finders_{make_brute_force(context), make_tiles(context)} {}

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    finders_.at(turn_++ % finders_.size())->find(search, sink, profiler);
  }

 private:
  std::array<std::unique_ptr<PairFinder>, 2> finders_;
  std::size_t turn_ = 0;
};

std::unique_ptr<PairFinder> make_turns(const opencl::Context& context) {
  return std::make_unique<Turns>(context);
}

/// An engine and the oracle that are told the same.
class EngineAndOracle {
 public:
  explicit EngineAndOracle(std::size_t slots)
      : engines_{make_delta_engine({}, make_turns), make_algorithm({.algorithm = "oracle"})} {
    for (const auto& engine : engines_) engine->reserve(slots);
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
  std::array<std::unique_ptr<Algorithm>, 2> engines_;
};

/// The result does not depend on which is asked: all boxes move or few, some are replaced or go, and their
/// number grows and shrinks.
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
      std::vector<std::uint32_t> renewed;
      if (all) {
        if (random() % 2 == 0) slots = most / 3 + static_cast<std::uint32_t>(random() % (most - most / 3));
        for (std::uint32_t slot = 0; slot < slots; ++slot) both.write(slot, boxes.boxes()[slot]);
      } else {
        for (std::uint32_t slot = 0; slot < slots; slot += 1 + static_cast<std::uint32_t>(random() % 200)) {
          changed.push_back(slot);
          const bool goes = random() % 8 == 0;
          both.write(slot, goes ? empty_aabb() : boxes.boxes()[slot]);
          if (goes || random() % 4 == 0) renewed.push_back(slot);
        }
      }
      ASSERT_TRUE(both.agree({.slots = slots, .changed = changed, .all = all, .renewed = renewed}))
          << "seed " << seed << ", frame " << frame;
    }
  }
}

/// Tiles that are asked in every second frame cannot watch how their order ages, and renew it all the same,
/// though not each time.
TEST(Auto, TilesThatTakeTurnsSortOnceInAWhile) {
  constexpr std::uint32_t n = 500;
  scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::uniform);
  EngineAndOracle both(n);
  int searches = 0;
  int sorts = 0;
  for (int frame = 0; frame < 40; ++frame) {
    boxes.advance();
    for (std::uint32_t slot = 0; slot < n; ++slot) both.write(slot, boxes.boxes()[slot]);
    ASSERT_TRUE(both.agree({.slots = n, .changed = {}, .all = true, .renewed = {}}));
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
