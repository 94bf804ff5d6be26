#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include <gtest/gtest.h>

#include "core/core.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "expect_error.hpp"

/// map(): boxes written in place.
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallMappedBoxesAreThoseOfTheObjects) {
  BroadPhase broad_phase(config());
  const std::span<Aabb> boxes = broad_phase.map(40);
  EXPECT_EQ(boxes.size(), 40U);
  EXPECT_EQ(broad_phase.size(), 40U);
  for (std::uint32_t k = 0; k < 40; ++k) boxes[k] = apart(k / 2);
  EXPECT_EQ(broad_phase.update().added.size(), 20U);
  const std::span<Aabb> again = broad_phase.map(40);
  for (std::uint32_t k = 0; k < 40; ++k) ASSERT_EQ(again[k], apart(k / 2));
  EXPECT_TRUE(same(broad_phase.update(), {}, {}));
  again[0] = apart(1);
  EXPECT_TRUE(same(broad_phase.update(), {}, {})) << "not mapped any more";
}

TEST_P(EachAlgorithm, SmallMappedMemoryOutlivesTheObject) {
  MappedBoxes boxes;
  {
    BroadPhase broad_phase(config());
    boxes = broad_phase.map(40);
    for (std::uint32_t k = 0; k < 40; ++k) boxes[k] = apart(k);
    EXPECT_TRUE(same(broad_phase.update(), {}, {}));
    const MappedBoxes elsewhere = broad_phase.map(4000);
    for (Aabb& box : elsewhere) box = apart(0);
    EXPECT_NE(elsewhere.owner, boxes.owner);
  }
  for (std::uint32_t k = 0; k < 40; ++k) ASSERT_EQ(boxes[k], apart(k));
}

/// Boxes of free ids hold NaNs, as kernels expect, also those that are no longer in the map.
TEST(Map, LeavesNoBoxOfAFreeId) {
  for (const bool maps_again : {true, false}) {
    Core<Aabb> core(make_algorithm({.algorithm = "sweep-and-prune"}));
    std::ranges::fill(core.map(3), unit);
    core.remove(1);
    core.remove(2);
    if (maps_again) core.map(1)[0] = unit;
    for (const Aabb& box : {apart(1), apart(2)}) {  // in other memory, and in that of the map
      (void)core.update(BoxView(std::span(&box, 1)));
      for (const Aabb& free : core.boxes().subspan(1)) EXPECT_TRUE(has_nan(free));
    }
  }
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallANaNInAMapIsNamedAndMended) {
  BroadPhase broad_phase(config());
  for (int k = 0; k < 3; ++k) broad_phase.add(unit);
  (void)broad_phase.update();
  const std::span<Aabb> boxes = broad_phase.map(40);
  for (std::uint32_t k = 0; k < 40; ++k) boxes[k] = apart(k / 2);
  boxes[31].lower[1] = nan_value;
  boxes[17].upper[2] = nan_value;
  for (int time = 0; time < 2; ++time) {
    EXPECT_THAT(error_of([&] { (void)broad_phase.update(); }), HasSubstr("box 17 "));
    EXPECT_THAT(error_of([&] { broad_phase.begin(); }), HasSubstr("box 17 "));
  }
  EXPECT_EQ(broad_phase.pairs(), all_pairs(3));
  EXPECT_EQ(broad_phase.size(), 40U);
  boxes[17] = apart(8);
  EXPECT_THAT(error_of([&] { (void)broad_phase.finish(); }), HasSubstr("box 31 "));
  // A box that is still invalid does not become an empty one when it is mapped again.
  (void)broad_phase.map(40);
  EXPECT_THAT(error_of([&] { (void)broad_phase.update(); }), HasSubstr("box 31 "));
  broad_phase.move(31, apart(15));
  const Delta delta = broad_phase.update();
  EXPECT_EQ(delta.added.size(), 19U);
  EXPECT_TRUE(same("removed", delta.removed, Pairs{{0, 2}, {1, 2}}));
}

/// So many boxes that several threads check them.
NOT_IN(sanitizers, "has a million boxes");
TEST(Map, AMillionBoxesAreLookedAtInParts) {
  constexpr std::size_t n = (std::size_t{1} << 20U) + 77;
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  const std::span<Aabb> boxes = broad_phase.map(n);
  for (std::size_t k = 0; k < n; ++k) boxes[k] = apart(k);
  boxes[n - 1].lower[0] = nan_value;
  boxes[700'000].upper[2] = nan_value;
  EXPECT_THAT(error_of([&] { (void)broad_phase.update(); }), HasSubstr("box 700000 "));
  broad_phase.move(700'000, inverted);
  EXPECT_THAT(error_of([&] { (void)broad_phase.update(); }), HasSubstr("box 1048652 "));
  broad_phase.move(n - 1, apart(5));
  EXPECT_TRUE(same(broad_phase.update(), Pairs{{5, n - 1}}, {}));
  const std::span<Aabb> again = broad_phase.map(n);
  EXPECT_TRUE(is_empty(again[700'000]) && !has_nan(again[700'000]));
  EXPECT_EQ(again[999'999], apart(999'999));
  again[700'000] = apart(7);
  EXPECT_TRUE(same(broad_phase.update(), Pairs{{7, 700'000}}, {}));
}

}  // namespace
}  // namespace broadcl::test
