#include <broadcl/box_view.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <deque>
#include <initializer_list>
#include <limits>
#include <list>
#include <random>
#include <ranges>
#include <type_traits>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/eigen.hpp>

#include "base/packed_boxes.hpp"
#include "boxes.hpp"
#include "expect_error.hpp"
#include "runs.hpp"

namespace broadcl {
namespace {

using test::unit;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::size_t of_many_threads = 200'001;

template <class S>
constexpr S nan_of = std::numeric_limits<S>::quiet_NaN();

/// Six numbers: lower x, y, z, upper x, y, z.
template <class S>
using Numbers = std::array<S, 6>;

/// Boxes of every kind but NaN: random ones, about a tenth of them empty, and the limits of the type.
template <class S>
std::vector<Numbers<S>> boxes_of_every_kind(std::size_t n) {
  using Limits = std::numeric_limits<S>;
  const std::vector<Numbers<S>> special{
      {S(-0.0), S(0.0), S(-0.0), S(0.0), S(-0.0), S(-0.0)},
      {-Limits::infinity(), -Limits::infinity(), 0, Limits::infinity(), 0, Limits::infinity()},
      {-Limits::denorm_min(), Limits::denorm_min(), 0, 0, Limits::min(), Limits::denorm_min()},
      {Limits::lowest(), 0, 0, Limits::max(), 1, 1},
      {Limits::max(), Limits::max(), Limits::max(), Limits::lowest(), Limits::lowest(), Limits::lowest()},
      {Limits::infinity(), 0, 0, -Limits::infinity(), 1, 1},
      {S(1) + Limits::epsilon(), 0, 0, S(1), 1, 1},
      {S(0.1), S(0.2), S(-0.3), S(0.1), S(0.2), S(-0.3)}};
  std::mt19937 random(7);
  std::uniform_real_distribution<S> position(-10, 10);
  std::uniform_real_distribution<S> edge(S(-0.1), 2);
  std::vector<Numbers<S>> boxes;
  for (std::size_t k = 0; k < n; ++k) {
    if (k % 50 < special.size()) {
      boxes.push_back(special[k % 50]);
      continue;
    }
    Numbers<S> box{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box[axis] = position(random);
      box[axis + 3] = box[axis] + edge(random);
    }
    boxes.push_back(box);
  }
  return boxes;
}

template <class S>
bool is_empty_box(const Numbers<S>& box) {
  return box[0] > box[3] || box[1] > box[4] || box[2] > box[5];
}

Aabb expected_box(const Numbers<float>& box) {
  return {{box[0], box[1], box[2]}, {box[3], box[4], box[5]}};
}

Aabb expected_box(const Numbers<double>& box) {
  return round_outward({box[0], box[1], box[2]}, {box[3], box[4], box[5]});
}

/// The expected result of packed().
template <class S>
std::vector<Aabb> expected_packed(const std::vector<Numbers<S>>& boxes) {
  std::vector<Aabb> packed(boxes.size());
  std::ranges::transform(boxes, packed.begin(), [](const Numbers<S>& box) {
    return is_empty_box(box) ? packed_empty() : expected_box(box);
  });
  return packed;
}

/// As bits, NaNs equal each other, and -0 differs from 0.
std::vector<std::array<std::uint32_t, 6>> bits(std::span<const Aabb> boxes) {
  std::vector<std::array<std::uint32_t, 6>> all;
  for (const Aabb& box : boxes) all.push_back(std::bit_cast<std::array<std::uint32_t, 6>>(box));
  return all;
}

std::vector<Aabb> copied(const BoxView& view) {
  std::vector<Aabb> out(view.size());
  view.copy_to(out);
  return out;
}

std::vector<Aabb> packed(const BoxView& view) {
  return packed_boxes<Aabb>(view, 0);
}

/// Boxes in memory that ends right after the last one, with NaN in the gaps between bounds.
template <class S>
struct Layout {
  std::string name;
  std::vector<S> memory;
  BoxView view;
};

/// @param step Distance from one box to the next, in numbers.
/// @param make Makes the view, given a function that returns the address of bound `index` of box 0.
template <class S, class Make>
Layout<S> lay_out(std::string name, const std::vector<Numbers<S>>& boxes,
                  const std::array<std::size_t, 6>& first, std::ptrdiff_t step, const Make& make) {
  Layout<S> layout{std::move(name), {}, {}};
  std::array<std::size_t, 6> origin = first;
  const std::size_t last = boxes.empty() ? 0 : boxes.size() - 1;
  if (step < 0) {
    for (std::size_t& index : origin) index += last * static_cast<std::size_t>(-step);
  }
  const std::size_t end = *std::max_element(first.begin(), first.end()) + 1 +
                          last * static_cast<std::size_t>(step < 0 ? -step : step);
  layout.memory.assign(end, nan_of<S>);
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    for (std::size_t index = 0; index < 6; ++index) {
      const auto offset = static_cast<std::ptrdiff_t>(origin[index]) + static_cast<std::ptrdiff_t>(k) * step;
      layout.memory[static_cast<std::size_t>(offset)] = boxes[k][index];
    }
  }
  const auto bound = [&](std::size_t index) -> const S* { return layout.memory.data() + origin[index]; };
  layout.view = make(bound, boxes.size(), step * static_cast<std::ptrdiff_t>(sizeof(S)));
  return layout;
}

template <class S>
std::vector<Layout<S>> layouts(const std::vector<Numbers<S>>& boxes) {
  const auto interleaved = [](const auto& bound, std::size_t n, std::ptrdiff_t stride) {
    return BoxView::interleaved(bound(0), n, stride);
  };
  const auto corners = [](const auto& bound, std::size_t n, std::ptrdiff_t stride) {
    return BoxView::corners(bound(0), bound(3), n, stride);
  };
  const auto arrays = [](const auto& bound, std::size_t n, std::ptrdiff_t stride) {
    return BoxView::arrays<S>({bound(0), bound(1), bound(2)}, {bound(3), bound(4), bound(5)}, n, stride);
  };
  const std::size_t n = boxes.size();
  std::vector<Layout<S>> all;
  const auto add = [&](const char* name, const std::array<std::size_t, 6>& first, std::ptrdiff_t step,
                       const auto& make) { all.push_back(lay_out(name, boxes, first, step, make)); };
  add("interleaved", {0, 1, 2, 3, 4, 5}, 6, interleaved);
  add("interleaved, padded", {3, 4, 5, 6, 7, 8}, 11, interleaved);
  add("interleaved, reversed and padded", {1, 2, 3, 4, 5, 6}, -9, interleaved);
  add("corners", {0, 1, 2, 3 * n, 3 * n + 1, 3 * n + 2}, 3, corners);
  add("corners, upper first and apart", {5, 6, 7, 1, 2, 3}, 9, corners);
  add("corners, reversed", {3 * n, 3 * n + 1, 3 * n + 2, 0, 1, 2}, -3, corners);
  add("arrays", {0, n, 2 * n, 3 * n, 4 * n, 5 * n}, 1, arrays);
  add("arrays, every third", {0, 3 * n + 1, 6 * n, 9 * n + 5, 12 * n + 5, 15 * n + 5}, 3, arrays);
  add("arrays, reversed", {0, n, 2 * n, 3 * n, 4 * n, 5 * n}, -1, arrays);
  add("arrays, upper z first", {5, 4, 3, 2, 1, 0}, 6, arrays);
  return all;
}

template <class S>
class BoxViewOf : public ::testing::Test {};
using BothTypes = ::testing::Types<float, double>;
TYPED_TEST_SUITE(BoxViewOf, BothTypes, );

TYPED_TEST(BoxViewOf, EveryLayoutReadsTheSameBoxes) {
  for (const std::size_t n : std::array<std::size_t, 4>{1, 2, 100, of_many_threads}) {
    const auto boxes = boxes_of_every_kind<TypeParam>(n);
    const auto expected = bits(expected_packed(boxes));
    for (const Layout<TypeParam>& layout : layouts(boxes)) {
      ASSERT_EQ(layout.view.size(), n) << layout.name;
      ASSERT_TRUE(bits(packed(layout.view)) == expected) << layout.name << ", " << n;
      std::vector<Aabb> out = copied(layout.view);
      std::vector<Aabb> one_by_one;
      for (std::size_t k = 0; k < n; ++k) one_by_one.push_back(layout.view[k]);
      ASSERT_TRUE(bits(one_by_one) == bits(out)) << layout.name;
      ASSERT_TRUE(std::ranges::none_of(out, has_nan)) << layout.name;
      std::ranges::transform(out, out.begin(), pack<Aabb>);
      ASSERT_TRUE(bits(out) == expected) << layout.name;
    }
  }
}

TYPED_TEST(BoxViewOf, InvertedBoxesAreCountedInEveryLayout) {
  using S = TypeParam;
  constexpr S unbounded = std::numeric_limits<S>::infinity();
  const auto inverted_of = [](const std::vector<Numbers<S>>& boxes) {
    std::vector<std::size_t> inverted;
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      const auto is_inverted = [&box = boxes[k]](std::size_t axis) {
        return box[axis] > box[axis + 3] && (box[axis] != unbounded || box[axis + 3] != -unbounded);
      };
      if (is_inverted(0) || is_inverted(1) || is_inverted(2)) inverted.push_back(k);
    }
    return inverted;
  };
  const auto expect_counted = [&](const std::vector<Numbers<S>>& boxes) {
    const std::vector<std::size_t> expected = inverted_of(boxes);
    for (const Layout<S>& layout : layouts<S>(boxes)) {
      SCOPED_TRACE(layout.name);
      const InvertedBoxes inverted = layout.view.inverted();
      EXPECT_EQ(inverted.count, expected.size());
      EXPECT_EQ(inverted.first, expected.empty() ? 0 : expected.front());
      EXPECT_EQ(inverted.likely, BoxLayout::min_max);
    }
  };
  std::vector<Numbers<S>> boxes = boxes_of_every_kind<S>(300);
  expect_counted(boxes);
  for (const std::size_t k : inverted_of(boxes)) boxes[k] = {unbounded, 0, 0, -unbounded, 1, 1};
  expect_counted(boxes);
  for (const std::size_t k : {std::size_t{250}, boxes.size() - 1}) {
    boxes[k] = {0, 0, 1, 1, 1, 0};
    expect_counted(boxes);
  }
}

TYPED_TEST(BoxViewOf, TheLikelyLayoutOfInvertedBoxes) {
  using S = TypeParam;
  constexpr S unbounded = std::numeric_limits<S>::infinity();
  const auto likely = [](const std::vector<S>& numbers) {
    return BoxView::interleaved(numbers.data(), numbers.size() / 6).inverted().likely;
  };
  EXPECT_EQ(likely({0, 1, 0, 1, 0, 1, 5, 6, 1, 2, 1, 2, unbounded, -unbounded, 0, 0, 0, 1}), BoxLayout::axes);
  EXPECT_EQ(likely({5, 6, 7, 1, 0, 1, 8, 0, 7, 1, 2, 1, 0, 0, 0, 1, 1, 1}), BoxLayout::centre_size);
  EXPECT_EQ(likely({5, 6, 7, 1, 0, 1, 8, 0, 7, 1, 2, -1, 0, 0, 0, 1, 1, 1}), BoxLayout::min_max);
  EXPECT_EQ(likely({5, 6, 7, 1, 0, 1, 0, 0, 0, 1, 2, 1, 0, 0, 0, 1, 1, 1}), BoxLayout::min_max);
  const std::vector<S> flat{0, 1, 0, 1, 5, 6, 1, 2};
  EXPECT_EQ(BoxView::rectangles(flat.data(), 2).inverted().likely, BoxLayout::axes);
  const std::vector<S> centres{5, 6, 1, 1, 8, 9, 2, 1};
  EXPECT_EQ(BoxView::rectangles(centres.data(), 2).inverted().likely, BoxLayout::centre_size);
  EXPECT_EQ(BoxView().inverted().count, 0U);
}

TYPED_TEST(BoxViewOf, NoBoxesNeedNoMemory) {
  using S = TypeParam;
  const S* none = nullptr;
  const std::array views{BoxView::interleaved(none, 0), BoxView::corners(none, none, 0),
                         BoxView::arrays<S>({}, {}, 0), BoxView::interleaved(none, 0, 1), BoxView()};
  for (const BoxView& view : views) {
    EXPECT_EQ(view.size(), 0U);
    view.copy_to({});
  }
  EXPECT_TRUE(overlapping_pairs(BoxView()).empty());
}

TYPED_TEST(BoxViewOf, AStrideOfZeroMeansWithoutGaps) {
  const Numbers<TypeParam> numbers{0, 1, 2, 3, 4, 5};
  const TypeParam* const first = numbers.data();
  EXPECT_EQ(packed(BoxView::interleaved(first, 1, 0)), std::vector({Aabb{{0, 1, 2}, {3, 4, 5}}}));
  EXPECT_EQ(packed(BoxView::corners(first, first, 2, 0)),
            std::vector({Aabb{{0, 1, 2}, {0, 1, 2}}, Aabb{{3, 4, 5}, {3, 4, 5}}}));
  const auto of_arrays = BoxView::arrays<TypeParam>({first, first, first}, {first, first, first}, 2, 0);
  EXPECT_EQ(packed(of_arrays), std::vector({Aabb{{0, 0, 0}, {0, 0, 0}}, Aabb{{1, 1, 1}, {1, 1, 1}}}));
}

TYPED_TEST(BoxViewOf, ANaNIsNamedWhicheverBoundItIs) {
  for (std::size_t index = 0; index < 6; ++index) {
    std::vector<Numbers<TypeParam>> boxes(5, {0, 0, 0, 1, 1, 1});
    boxes[2] = {1, 1, 1, 0, 0, 0};  // empty, and no error
    boxes[3] = {1, 1, 1, 0, 0, 0};  // empty, and an error
    boxes[3][index] = nan_of<TypeParam>;
    boxes[4][index] = nan_of<TypeParam>;
    for (const Layout<TypeParam>& layout : layouts(boxes)) {
      const auto text = test::error_of([&] { (void)packed(layout.view); });
      EXPECT_THAT(text, AllOf(HasSubstr("box 3 has a NaN bound"), HasSubstr("give an empty box")))
          << layout.name;
      EXPECT_TRUE(has_nan(layout.view[3])) << layout.name;
      EXPECT_TRUE(has_nan(copied(layout.view)[3])) << layout.name;
    }
  }
}

NOT_IN(sanitizers, "takes long");
TYPED_TEST(BoxViewOf, OfManyNaNsTheFirstIsNamedWhateverTheThreadsDo) {
  const auto boxes = boxes_of_every_kind<TypeParam>(of_many_threads);
  // These include the last box of one thread and the first of the next, with two threads and with three.
  for (const std::size_t first :
       std::array<std::size_t, 6>{0, 66'666, 66'667, 100'000, 100'001, of_many_threads - 1}) {
    auto invalid = boxes;
    for (const std::size_t later : std::array<std::size_t, 6>{0, 1, 500, 40'000, 90'000, 130'000}) {
      if (first + later < invalid.size()) invalid[first + later][later % 6] = nan_of<TypeParam>;
    }
    const auto view = BoxView::interleaved(invalid[0].data(), invalid.size());
    EXPECT_THAT(test::error_of([&] { (void)packed(view); }),
                HasSubstr("box " + std::to_string(first) + " has"));
  }
}

TYPED_TEST(BoxViewOf, InvalidMemoryIsAnErrorThatSaysWhatToDo) {
  using S = TypeParam;
  const std::vector<S> numbers(20);
  const S* some = numbers.data();
  const S* null = nullptr;
  const auto* misaligned = reinterpret_cast<const S*>(reinterpret_cast<const std::byte*>(some) + 2);
  const std::string multiple = "not a multiple of " + std::to_string(sizeof(S));
  const auto error_of = [](const auto& make) { return test::error_of([&] { (void)make(); }); };

  EXPECT_THAT(error_of([&] { return BoxView::interleaved(null, 2); }),
              AllOf(HasSubstr("2 boxes"), HasSubstr("null pointer; give 0 boxes")));
  EXPECT_THAT(error_of([&] { return BoxView::corners(null, some, 2); }), HasSubstr("null"));
  EXPECT_THAT(error_of([&] { return BoxView::corners(some, null, 2); }), HasSubstr("null"));
  for (std::size_t index = 0; index < 6; ++index) {
    for (const S* wrong : {null, misaligned}) {
      std::array<const S*, 6> bounds{some, some, some, some, some, some};
      bounds[index] = wrong;
      EXPECT_THAT(error_of([&] {
                    return BoxView::arrays<S>({bounds[0], bounds[1], bounds[2]},
                                              {bounds[3], bounds[4], bounds[5]}, 2);
                  }),
                  HasSubstr(wrong == null ? "null" : multiple + " bytes; copy"));
    }
  }
  EXPECT_THAT(error_of([&] { return BoxView::interleaved(misaligned, 2); }), HasSubstr(multiple));
  EXPECT_THAT(error_of([&] { return BoxView::corners(some, misaligned, 2); }), HasSubstr(multiple));

  EXPECT_THAT(error_of([&] { return BoxView::interleaved(some, 2, 25); }),
              AllOf(HasSubstr("stride of 25 bytes"), HasSubstr(multiple), HasSubstr("copy the boxes")));
  EXPECT_THAT(error_of([&] { return BoxView::corners(some, some, 2, -26); }), HasSubstr("stride of -26"));
  EXPECT_THAT(error_of([&] {
                return BoxView::arrays<S>({some, some, some}, {some, some, some}, 2, 2);
              }),
              HasSubstr("stride of 2 bytes"));

  constexpr auto most = std::numeric_limits<std::ptrdiff_t>::max();
  constexpr auto least = std::numeric_limits<std::ptrdiff_t>::min();
  const auto too_large = AllOf(HasSubstr("larger than memory"), HasSubstr("give the number of boxes"));
  constexpr std::size_t far_too_many = std::numeric_limits<std::size_t>::max();
  for (const std::ptrdiff_t stride :
       {std::ptrdiff_t{0}, std::ptrdiff_t{48}, std::ptrdiff_t{-48}, most / 64 * 64, least})
    EXPECT_THAT(error_of([&] { return BoxView::interleaved(some, far_too_many, stride); }), too_large);
  EXPECT_THAT(error_of([&] { return BoxView::interleaved(some, 1, least); }), too_large);
  EXPECT_THAT(error_of([&] { return BoxView::corners(some, some, 3, most / 16 * 8); }), too_large);
}

TYPED_TEST(BoxViewOf, ACopyThatDoesNotFitIsAnError) {
  const std::vector<TypeParam> numbers(12);
  const auto view = BoxView::interleaved(numbers.data(), 2);
  std::vector<Aabb> out(1);
  EXPECT_THAT(test::error_of([&] { view.copy_to(out); }),
              AllOf(HasSubstr("2 boxes do not fit into memory for 1;"), HasSubstr("give memory for all")));
  std::vector<Aabb> larger(3, unit);
  view.copy_to(larger);
  EXPECT_EQ(larger, (std::vector<Aabb>{Aabb{}, Aabb{}, unit}));
}

TEST(BoxView, RoundedDoublesHaveASupersetOfThePairs) {
  const auto touch = [](double upper, double lower) {
    const std::vector<Numbers<double>> boxes{{0, 0, 0, upper, 1, 1}, {lower, 0, 0, 2, 1, 1}};
    BroadPhase broad_phase({.algorithm = "oracle"});
    (void)broad_phase.add(BoxView::interleaved(boxes[0].data(), 2));
    return !broad_phase.update().added.empty();
  };
  EXPECT_TRUE(touch(1, 1));
  // Apart by less than float32 can resolve.
  EXPECT_TRUE(touch(1, 1 + 1e-12));
  EXPECT_TRUE(touch(1 - 1e-12, 1));
  EXPECT_FALSE(touch(1, 1 + 1e-3));
  // Both bounds lie between the same two float32 numbers: rounded inward, they would separate.
  EXPECT_TRUE(touch(1 + 5e-8, 1 + 5e-8));
}

TEST(BoxView, MoreBoxesThanSlotsAreRefused) {
  const Numbers<float> box{0, 0, 0, 1, 1, 1};
  const auto view = BoxView::interleaved(box.data(), (std::size_t{1} << 31U) + 1, 0);
  EXPECT_THAT(test::error_of([&] { (void)overlapping_pairs(view); }),
              HasSubstr("more than 2147483648 boxes"));
}

TEST(BoxView, BoxesInAStructAreViewedInPlace) {
  struct Particle {
    std::array<double, 3> lower;
    float mass;
    std::array<double, 3> upper;
  };
  std::vector<Particle> particles(3, {{0, 0, 0}, nan_of<float>, {1, 1, 1}});
  const auto view = BoxView::corners(particles[0].lower.data(), particles[0].upper.data(), particles.size(),
                                     sizeof(Particle));
  particles[1] = {{5, 5, 5}, 1, {6, 6, 6}};
  EXPECT_EQ(view[1], (Aabb{{5, 5, 5}, {6, 6, 6}}));
  EXPECT_EQ(overlapping_pairs(view), (std::vector<Pair>{{0, 2}}));
}

/// Converts to Aabb, but is not one.
struct Ball {
  std::array<float, 3> centre;
  float radius;

  operator Aabb() const {
    return {{centre[0] - radius, centre[1] - radius, centre[2] - radius},
            {centre[0] + radius, centre[1] + radius, centre[2] + radius}};
  }
};

TEST(BoxView, ContiguousRangesOfAabbAreViewedOthersCopied) {
  static_assert(std::is_convertible_v<std::vector<Aabb>&, BoxView>);
  static_assert(std::is_convertible_v<const std::vector<Aabb>&, BoxView>);
  static_assert(std::is_convertible_v<std::span<const Aabb>, BoxView>);
  static_assert(std::is_convertible_v<std::span<Aabb, 3>, BoxView>);
  static_assert(std::is_convertible_v<std::array<Aabb, 3>&, BoxView>);
  static_assert(std::is_convertible_v<const Aabb(&)[3], BoxView>);  // NOLINT(modernize-avoid-c-arrays)
  static_assert(!std::constructible_from<BoxView, std::vector<Aabb>>);
  static_assert(!std::constructible_from<BoxView, const std::vector<Aabb>>);
  static_assert(!std::constructible_from<BoxView, std::array<Aabb, 3>>);
  static_assert(!std::constructible_from<BoxView, std::initializer_list<Aabb>>);
  static_assert(AabbRange<std::vector<Aabb>> && AabbRange<std::initializer_list<Aabb>>);
  static_assert(!AabbRange<std::vector<Aabb>&> && !AabbRange<std::span<const Aabb>>);
  static_assert(AabbRange<std::list<Aabb>&> && AabbRange<std::vector<Ball>&>);
  static_assert(!std::is_convertible_v<std::list<Aabb>, BoxView>);
  static_assert(!std::is_convertible_v<std::vector<Ball>, BoxView>);
  static_assert(!std::is_convertible_v<std::vector<float>, BoxView> && !AabbRange<std::vector<float>>);

  std::vector<Aabb> boxes(3, unit);
  const BoxView view = boxes;
  boxes[1] = {{5, 5, 5}, {6, 6, 6}};
  EXPECT_EQ(copied(view), boxes);
}

TEST(BoxView, PairsOfEveryKindOfRange) {
  const std::vector<Ball> balls{{{0, 0, 0}, 1}, {{5, 0, 0}, 1}, {{1, 0, 0}, 1}, {{6, 0, 0}, 1}};
  const std::vector<Aabb> boxes(balls.begin(), balls.end());
  const std::vector<Pair> expected{{0, 2}, {1, 3}};
  const BroadPhase::Config oracle{.algorithm = "oracle"};
  const std::array<Aabb, 4> array{boxes[0], boxes[1], boxes[2], boxes[3]};
  const Aabb c_array[] = {boxes[0], boxes[1], boxes[2], boxes[3]};  // NOLINT(modernize-avoid-c-arrays)
  EXPECT_EQ(overlapping_pairs(boxes), expected);
  EXPECT_EQ(overlapping_pairs(std::vector(boxes), {}, oracle), expected);
  EXPECT_EQ(overlapping_pairs(std::initializer_list<Aabb>{boxes[0], boxes[2]}, {}, oracle),
            (std::vector<Pair>{{0, 1}}));
  EXPECT_EQ(overlapping_pairs(std::span(boxes), {}, oracle), expected);
  EXPECT_EQ(overlapping_pairs(std::span(boxes).first(3), {}, oracle), (std::vector<Pair>{{0, 2}}));
  EXPECT_EQ(overlapping_pairs(array, {}, oracle), expected);
  EXPECT_EQ(overlapping_pairs(c_array, {}, oracle), expected);
  EXPECT_EQ(overlapping_pairs(balls, {}, oracle), expected);
  EXPECT_EQ(overlapping_pairs(std::list(boxes.begin(), boxes.end()), {}, oracle), expected);
  EXPECT_EQ(overlapping_pairs(std::deque(balls.begin(), balls.end()), {}, oracle), expected);
  std::list<Aabb> invalid(3, unit);
  invalid.back().lower[1] = nan_of<float>;
  EXPECT_THAT(test::error_of([&] { (void)overlapping_pairs(invalid, {}, oracle); }), HasSubstr("box 2"));
}

#if !defined(__clang__) || __clang_major__ >= 16  // older Clang does not compile libstdc++'s views
TEST(BoxView, PairsOfViewsOfTheStandardLibrary) {
  const std::vector<Aabb> boxes{unit, {{5, 0, 0}, {6, 1, 1}}, {{1, 0, 0}, {2, 1, 1}}};
  const BroadPhase::Config oracle{.algorithm = "oracle"};
  const auto widen = [](Aabb box) {
    box.upper[0] += 3;
    return box;
  };
  EXPECT_EQ(overlapping_pairs(boxes | std::views::transform(widen), {}, oracle),
            (std::vector<Pair>{{0, 2}, {1, 2}}));
  const auto is_left = [](const Aabb& box) { return box.lower[0] < 3; };
  EXPECT_EQ(overlapping_pairs(boxes | std::views::filter(is_left), {}, oracle), (std::vector<Pair>{{0, 1}}));
  EXPECT_EQ(overlapping_pairs(boxes | std::views::reverse | std::views::drop(1), {}, oracle),
            std::vector<Pair>{});
  static_assert(std::is_convertible_v<decltype(boxes | std::views::drop(1)), BoxView>);
}
#endif

template <class S>
concept CanBeBounds = requires(const S* numbers, const std::array<const S*, 3>& corner) {
  BoxView::interleaved(numbers, std::size_t{1});
  BoxView::corners(numbers, numbers, std::size_t{1});
  BoxView::arrays(corner, corner, std::size_t{1});
};
static_assert(CanBeBounds<float> && CanBeBounds<double>);
static_assert(!CanBeBounds<long double> && !CanBeBounds<int> && !CanBeBounds<std::byte>);

/// An n x 6 matrix of the boxes.
template <class Matrix>
Matrix matrix_of(const std::vector<Numbers<typename Matrix::Scalar>>& boxes) {
  Matrix matrix(static_cast<Eigen::Index>(boxes.size()), 6);
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    for (std::size_t index = 0; index < 6; ++index)
      matrix(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(index)) = boxes[k][index];
  }
  return matrix;
}

TYPED_TEST(BoxViewOf, EigenMatricesOfEitherOrderAndTheirParts) {
  using S = TypeParam;
  using ColumnMajor = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;
  using RowMajor = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  using AnyStride = Eigen::Stride<Eigen::Dynamic, Eigen::Dynamic>;
  const auto boxes = boxes_of_every_kind<S>(60);
  const auto expected = bits(expected_packed(boxes));
  const auto bits_of = [](const auto& matrix) { return bits(packed(box_view(matrix))); };

  const auto test_order = [&]<class Matrix>(const Matrix& matrix) {
    EXPECT_EQ(bits_of(matrix), expected);
    Matrix larger = Matrix::Constant(70, 9, nan_of<S>);
    larger.block(4, 2, 60, 6) = matrix;
    EXPECT_EQ(bits_of(larger.block(4, 2, 60, 6)), expected);
    EXPECT_EQ(bits_of(std::as_const(larger).middleRows(4, 60).middleCols(2, 6)), expected);
    const Eigen::Ref<const Matrix> ref = larger.block(4, 2, 60, 6);
    EXPECT_EQ(bits_of(ref), expected);
    const Eigen::Ref<Matrix, 0, AnyStride> strided_ref = larger.block(4, 2, 60, 6);
    EXPECT_EQ(bits_of(strided_ref), expected);
    const Eigen::Map<const Matrix> map(matrix.data(), 60, 6);
    EXPECT_EQ(bits_of(map.array()), expected);
    const Matrix across = matrix.transpose();
    EXPECT_EQ(bits_of(across.transpose()), expected);
  };
  test_order(matrix_of<ColumnMajor>(boxes));
  test_order(matrix_of<RowMajor>(boxes));
  EXPECT_EQ(bits_of(matrix_of<Eigen::Matrix<S, 60, 6, Eigen::RowMajor>>(boxes)), expected);
  EXPECT_EQ(bits_of(matrix_of<Eigen::Array<S, Eigen::Dynamic, 6>>(boxes)), expected);
  Eigen::Matrix<S, 1, 6> row;
  row << 0, 0, 0, 1, 1, 1;
  EXPECT_EQ(box_view(row)[0], unit);

  // Every second number in rows of 15 and in columns of 121.
  std::vector<S> memory(60 * 15, nan_of<S>);
  Eigen::Map<RowMajor, 0, AnyStride> rows(memory.data(), 60, 6, AnyStride(15, 2));
  rows = matrix_of<RowMajor>(boxes);
  EXPECT_EQ(bits_of(rows), expected);
  std::vector<S> more_memory(6 * 121, nan_of<S>);
  Eigen::Map<ColumnMajor, 0, AnyStride> columns(more_memory.data(), 60, 6, AnyStride(121, 2));
  columns = matrix_of<ColumnMajor>(boxes);
  EXPECT_EQ(bits_of(columns), expected);
}

template <class Boxes>
concept HasBoxView = requires(Boxes boxes()) {
  box_view(boxes());
};

/// Temporaries that own their memory are refused.
template <class S, class Box = Eigen::AlignedBox<S, 3>, class Matrix = Eigen::Matrix<S, Eigen::Dynamic, 6>>
constexpr bool only_what_lasts_has_a_view =
    HasBoxView<std::vector<Box>&>&& HasBoxView<const std::vector<Box>&>&& HasBoxView<std::span<Box>> &&
    !HasBoxView<std::vector<Box>> && !HasBoxView<const std::vector<Box>> && HasBoxView<Matrix&> &&
    HasBoxView<const Matrix&> && HasBoxView<Eigen::Map<const Matrix>> && HasBoxView<Eigen::Block<Matrix>> &&
    HasBoxView<Eigen::Ref<Matrix>> && !HasBoxView<Matrix> && !HasBoxView<const Matrix> &&
    !HasBoxView<Eigen::Array<S, 9, 6>> && HasBoxView<const Eigen::Ref<const Matrix>&> &&
    !HasBoxView<Eigen::Ref<const Matrix>>;
static_assert(only_what_lasts_has_a_view<float> && only_what_lasts_has_a_view<double>);

TYPED_TEST(BoxViewOf, EigenMatricesAreViewedNotCopied) {
  Eigen::Matrix<TypeParam, Eigen::Dynamic, 6> matrix(2, 6);
  matrix << 0, 0, 0, 1, 1, 1, 5, 5, 5, 6, 6, 6;
  const BoxView view = box_view(matrix);
  EXPECT_EQ(view[1], (Aabb{{5, 5, 5}, {6, 6, 6}}));
  matrix.row(1) = matrix.row(0);
  EXPECT_EQ(view[1], unit);
}

TYPED_TEST(BoxViewOf, EigenMatricesHaveSixColumns) {
  using Matrix = Eigen::Matrix<TypeParam, Eigen::Dynamic, Eigen::Dynamic>;
  const Matrix no_rows(0, 6);
  EXPECT_EQ(box_view(no_rows).size(), 0U);
  for (const Eigen::Index columns : {0, 1, 5, 7}) {
    const Matrix matrix = Matrix::Zero(6, columns);
    EXPECT_THAT(test::error_of([&] { (void)box_view(matrix); }),
                AllOf(HasSubstr("have " + std::to_string(columns) + " columns"), HasSubstr("give six")));
  }
}

TYPED_TEST(BoxViewOf, EigenBoxes) {
  using Box = Eigen::AlignedBox<TypeParam, 3>;
  const auto boxes = boxes_of_every_kind<TypeParam>(100);
  std::vector<Box> eigen_boxes(boxes.size());
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      eigen_boxes[k].min()[static_cast<Eigen::Index>(axis)] = boxes[k][axis];
      eigen_boxes[k].max()[static_cast<Eigen::Index>(axis)] = boxes[k][axis + 3];
    }
  }
  const auto expected = bits(expected_packed(boxes));
  EXPECT_EQ(bits(packed(box_view(eigen_boxes))), expected);
  EXPECT_EQ(bits(packed(box_view(std::span<const Box>(eigen_boxes)))), expected);
  const std::array<Box, 2> empty_boxes{};
  EXPECT_EQ(bits(packed(box_view(empty_boxes))), bits(std::vector(2, packed_empty())));
  eigen_boxes.clear();
  EXPECT_EQ(box_view(eigen_boxes).size(), 0U);
}

}  // namespace
}  // namespace broadcl
