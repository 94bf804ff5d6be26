#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "boxes.hpp"
#include "core/core.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "engines/engine.hpp"
#include "environment.hpp"
#include "expect_error.hpp"
#include "failing_opencl.hpp"
#include "finder_variants.hpp"
#include "scenes/generators.hpp"
#include "twins.hpp"

namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

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

/// `auto` on the default device, whatever that is.
Twins<Core<Aabb>> twins_of_auto() {
  return Twins<Core<Aabb>>(std::in_place, NoTrouble(), false,
                           make_device_algorithm({}, static_cast<MakePairFinder>(&make_auto)));
}

/// Which finder does an update.
template <class Update>
std::string_view finder_of(const Update& update) {
  const long brute_force = launches_of("brute_force");
  const long tiles = launches_of("tiles_search");
  update();
  const bool used_brute_force = launches_of("brute_force") > brute_force;
  const bool used_tiles = launches_of("tiles_search") > tiles;
  EXPECT_NE(used_brute_force, used_tiles);
  return used_tiles ? "tiles" : "brute-force";
}

std::string_view finder_of_update(Twins<Core<Aabb>>& twins) {
  return finder_of([&] { EXPECT_TRUE(twins.agree()); });
}

Aabb box_apart(std::uint32_t k) {
  return apart(k);
}

void place(Twins<Core<Aabb>>& twins, std::uint32_t n, Aabb (*box)(std::uint32_t)) {
  twins.map(n, [&](std::span<Aabb> mapped) {
    for (std::uint32_t k = 0; k < n; ++k) mapped[k] = box(k);
  });
}

/// So few boxes that testing each pair takes little time on a device, but not if all of these overlap.
TEST(Auto, TestsAllPairsOfAFewBoxesUnlessTooManyOverlap) {
  const auto n = static_cast<std::uint32_t>(150 * std::sqrt(select_device().compute_units));
  const auto all_overlap = [](std::uint32_t /*k*/) { return unit; };
  Twins<Core<Aabb>> twins = twins_of_auto();
  place(twins, 100, box_apart);
  EXPECT_EQ(finder_of_update(twins), "brute-force");
  place(twins, n, all_overlap);
  EXPECT_EQ(finder_of_update(twins), "brute-force") << "which does not know the pairs yet";
  place(twins, n, all_overlap);
  EXPECT_EQ(finder_of_update(twins), "tiles");
  place(twins, 100, box_apart);
  (void)finder_of_update(twins);
  place(twins, 100, box_apart);
  EXPECT_EQ(finder_of_update(twins), "brute-force");
}

NOT_IN(gpu_profile | rusticl | sanitizers, "takes long");
TEST(Auto, DoesNotTestAllPairsOfManyBoxes) {
  constexpr std::uint32_t n = 200'000;
  if (is_slow_device()) GTEST_SKIP() << "takes long on this device";
  Core<Aabb> core(make_device_algorithm({}, static_cast<MakePairFinder>(&make_auto)));
  for (std::uint32_t k = 0; k < n; ++k) core.add(apart(k), {});
  EXPECT_EQ(finder_of([&] { (void)core.finish(); }), "tiles");
  // Few moved, but more than could be tested against so many while `tiles` look at a few boxes.
  const std::uint32_t moved = 2 * select_device().compute_units;
  for (std::uint32_t k = 0; k < moved; ++k) core.move(7 * k, apart(7 * k + 1));
  EXPECT_EQ(finder_of([&] { EXPECT_EQ(core.finish().added.size(), moved); }), "brute-force");
}

/// `brute-force` tests boxes of different worlds, too.
TEST(Auto, UsesTilesForWorlds) {
  Twins<Core<Aabb>> twins = twins_of_auto();
  for (std::uint32_t k = 0; k < 4; ++k) twins.add(unit, {.world = k / 2});
  EXPECT_EQ(finder_of_update(twins), "tiles");
}

/// If `tiles` is used only every second frame, it cannot watch how its order ages. It still sorts again, but
/// not each time.
TEST(Auto, TilesThatTakeTurnsSortOnceInAWhile) {
  constexpr std::uint32_t n = 500;
  scenes::MovingBoxes boxes(n, scenes::MovingBoxes::Sizes::uniform);
  Twins<Core<Aabb>> twins(std::in_place, NoTrouble(), false, make_device_algorithm({}, make_turns));
  const long searches = launches_of("tiles_search");
  const long sorts = launches_of("tiles_keys");
  for (int frame = 0; frame < 40; ++frame) {
    boxes.advance();
    twins.map(n, [&](std::span<Aabb> mapped) { std::ranges::copy(boxes.boxes(), mapped.begin()); });
    ASSERT_TRUE(twins.agree());
  }
  EXPECT_EQ(launches_of("tiles_search") - searches, 20);
  EXPECT_EQ(launches_of("tiles_keys") - sorts, 5);
}

}  // namespace
}  // namespace broadcl::test
