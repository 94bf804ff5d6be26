#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "expect_error.hpp"
#include "reference.hpp"
#include "twins.hpp"

/// What is set of all objects, in one call.
namespace broadcl::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

template <class Box>
class ObjectsOf : public ::testing::Test {
 protected:
  using Bound = typename BasicBroadPhase<Box>::Bound;
  using Ids = std::vector<std::uint32_t>;

  static Box at(Bound x) { return {{x, 0, 0}, {x + 1, 1, 1}}; }

  /// Objects 0, 2 and 3, which differ in all.
  void add_three() {
    for (int k = 0; k < 4; ++k) broad_phase_.add(at(static_cast<Bound>(k)));
    broad_phase_.remove(1);
    const Ids ids{0, 2, 3};
    broad_phase_.set_filters(ids, std::vector<Filter>{{.body = 7}, {.world = 2}, {.group = 4, .mask = 6}});
    broad_phase_.set_reach(ids, std::vector<Bound>{0, 0.5, 2});
  }

  BasicBroadPhase<Box> broad_phase_{{.algorithm = "sweep-and-prune"}};
};
using Precisions = ::testing::Types<Aabb, Aabb64>;
TYPED_TEST_SUITE(ObjectsOf, Precisions);

TYPED_TEST(ObjectsOf, NoneAreThereAtFirst) {
  EXPECT_THAT(this->broad_phase_.ids(), IsEmpty());
  EXPECT_THAT(this->broad_phase_.boxes(), IsEmpty());
  EXPECT_THAT(this->broad_phase_.filters(), IsEmpty());
  EXPECT_THAT(this->broad_phase_.reaches(), IsEmpty());
  EXPECT_THAT(this->broad_phase_.exclusions(), IsEmpty());
}

TYPED_TEST(ObjectsOf, AreInTheOrderOfTheirIds) {
  this->add_three();
  const auto& broad_phase = this->broad_phase_;
  EXPECT_THAT(broad_phase.ids(), ElementsAre(0, 2, 3));
  EXPECT_THAT(broad_phase.boxes(), ElementsAre(this->at(0), this->at(2), this->at(3)));
  EXPECT_THAT(broad_phase.filters(),
              ElementsAre(Filter{.body = 7}, Filter{.world = 2}, Filter{.group = 4, .mask = 6}));
  EXPECT_THAT(broad_phase.reaches(), ElementsAre(0, 0.5, 2));
}

TYPED_TEST(ObjectsOf, AreAsTheyAreSetNowAlsoDuringAnUpdate) {
  this->add_three();
  auto& broad_phase = this->broad_phase_;
  broad_phase.begin();
  broad_phase.move(2, this->at(20));
  broad_phase.remove(0);
  broad_phase.add(this->at(5), {.body = 1});
  broad_phase.add(this->at(6));
  EXPECT_THAT(broad_phase.ids(), ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(broad_phase.boxes(), ElementsAre(this->at(5), this->at(6), this->at(20), this->at(3)));
  EXPECT_EQ(broad_phase.filters()[0], Filter{.body = 1});
  EXPECT_THAT(broad_phase.reaches(), ElementsAre(0, 0, 0.5, 2));
  (void)broad_phase.finish();
  EXPECT_THAT(broad_phase.boxes(), ElementsAre(this->at(5), this->at(6), this->at(20), this->at(3)));
  broad_phase.map(2)[1] = this->at(9);
  EXPECT_THAT(broad_phase.boxes(), ElementsAre(this->at(5), this->at(9)));
}

TYPED_TEST(ObjectsOf, EmptyBoxesAreThoseOfBox) {
  constexpr auto infinity = std::numeric_limits<typename TestFixture::Bound>::infinity();
  auto& broad_phase = this->broad_phase_;
  broad_phase.add({{1, 0, 0}, {0, 1, 1}});
  EXPECT_EQ(broad_phase.boxes().front(), broad_phase.box(0));
  EXPECT_EQ(broad_phase.boxes().front().lower[0], infinity);
}

TYPED_TEST(ObjectsOf, WithADistanceReachHalfOfIt) {
  BasicBroadPhase<TypeParam> broad_phase({.algorithm = "sweep-and-prune", .distance = 3});
  broad_phase.add(this->at(0));
  EXPECT_THAT(broad_phase.reaches(), ElementsAre(1.5));
}

TYPED_TEST(ObjectsOf, ExclusionsAreInCanonicalOrderAndEachOnce) {
  auto& broad_phase = this->broad_phase_;
  broad_phase.set_exclusions(Pairs{{5, 1}, {0, 5}, {1, 5}, {3, 2}});
  EXPECT_THAT(broad_phase.exclusions(), ElementsAre(Pair{2, 3}, Pair{0, 5}, Pair{1, 5}));
  EXPECT_THAT(error_of([&] { broad_phase.set_exclusions(Pairs{{0, 1}, {4, 4}}); }), HasSubstr("and itself"));
  EXPECT_THAT(broad_phase.exclusions(), ElementsAre(Pair{2, 3}, Pair{0, 5}, Pair{1, 5}));
  broad_phase.set_exclusions({});
  EXPECT_THAT(broad_phase.exclusions(), IsEmpty());
}

TYPED_TEST(ObjectsOf, MakeTheSameObjectsElsewhere) {
  auto& broad_phase = this->broad_phase_;
  this->add_three();
  broad_phase.set_exclusions(Pairs{{2, 3}});
  BasicBroadPhase<TypeParam> other({.algorithm = "oracle"});
  const std::vector<TypeParam> boxes = broad_phase.boxes();
  other.add(BoxView(boxes), broad_phase.filters(), broad_phase.reaches());
  EXPECT_THAT(other.ids(), ElementsAre(0, 1, 2));
  EXPECT_EQ(other.boxes(), broad_phase.boxes());
  EXPECT_EQ(other.filters(), broad_phase.filters());
  EXPECT_EQ(other.reaches(), broad_phase.reaches());
  EXPECT_THAT(other.exclusions(), IsEmpty());
}

TYPED_TEST(ObjectsOf, FiltersAreOneForAllOrOneForEach) {
  auto& broad_phase = this->broad_phase_;
  for (int k = 0; k < 4; ++k) broad_phase.add(this->at(0));
  ASSERT_EQ(broad_phase.update().added.size(), 6U);
  const typename TestFixture::Ids ids{3, 1};
  broad_phase.set_filters(ids, std::vector<Filter>{{.body = 5}});
  EXPECT_EQ(to_vector(broad_phase.update().removed), (Pairs{{1, 3}}));
  broad_phase.set_filters(ids, std::vector<Filter>{{.world = 1}, {.world = ~0U}});
  EXPECT_TRUE(same(broad_phase.update(), Pairs{{1, 3}}, Pairs{{0, 3}, {2, 3}}));
  broad_phase.set_filters({}, std::vector<Filter>{{.mask = 0}});
  broad_phase.set_filters({}, {});
  const Delta delta = broad_phase.update();
  EXPECT_TRUE(delta.added.empty() && delta.removed.empty());
}

TYPED_TEST(ObjectsOf, TheLaterFilterOfAnIdCounts) {
  auto& broad_phase = this->broad_phase_;
  for (int k = 0; k < 2; ++k) broad_phase.add(this->at(0));
  ASSERT_EQ(broad_phase.update().added.size(), 1U);
  const typename TestFixture::Ids ids{1, 1, 0, 1};
  broad_phase.set_filters(ids, std::vector<Filter>{{.mask = 0}, {.world = 4}, {.body = 3}, {.body = 2}});
  EXPECT_THAT(broad_phase.filters(), ElementsAre(Filter{.body = 3}, Filter{.body = 2}));
  const Delta delta = broad_phase.update();
  EXPECT_TRUE(delta.added.empty() && delta.removed.empty());
}

TYPED_TEST(ObjectsOf, FiltersThatAreRefusedSetNone) {
  auto& broad_phase = this->broad_phase_;
  this->add_three();
  const std::vector<Filter> before = broad_phase.filters();
  (void)broad_phase.update();
  const std::vector<Filter> two{{.mask = 0}, {.mask = 0}};
  const typename TestFixture::Ids unknown{0, 1};
  EXPECT_THAT(error_of([&] { broad_phase.set_filters(unknown, two); }), HasSubstr("no object has the id 1"));
  const typename TestFixture::Ids three{0, 2, 3};
  EXPECT_THAT(error_of([&] { broad_phase.set_filters(three, two); }),
              HasSubstr("2 filters for 3 objects; give one for all, or one for each"));
  EXPECT_THAT(error_of([&] { broad_phase.set_filters(three, {}); }), HasSubstr("0 filters for 3 objects"));
  EXPECT_EQ(broad_phase.filters(), before);
  const Delta delta = broad_phase.update();
  EXPECT_TRUE(delta.added.empty() && delta.removed.empty());
}

}  // namespace
}  // namespace broadcl::test
