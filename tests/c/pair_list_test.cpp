#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "c_test.hpp"

namespace broadcl::test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

/// The pairs of a list, which is destroyed.
Pairs taken_from(broadcl_pair_list* made) {
  broadcl_pairs pairs{};
  EXPECT_EQ(broadcl_pair_list_pairs(made, &pairs), BROADCL_SUCCESS);
  Pairs result = list(pairs);
  EXPECT_EQ(broadcl_pair_list_destroy(made), BROADCL_SUCCESS);
  return result;
}

TEST(CPairList, HasAllPairsOfBoxesInAnyLayout) {
  const std::vector<broadcl_aabb> boxes = random_boxes(200);
  const Pairs expected = overlapping(boxes);
  ASSERT_GT(expected.size(), 20U);
  const auto pairs_of = [](const broadcl_boxes& given) {
    const broadcl_config config = on_host();
    broadcl_pair_list* pairs = nullptr;
    EXPECT_EQ(broadcl_pair_list_create(&given, nullptr, nullptr, 0, &config, &pairs), BROADCL_SUCCESS)
        << broadcl_last_error();
    return taken_from(pairs);
  };
  EXPECT_EQ(pairs_of(view(boxes)), expected);

  std::vector<std::array<float, 8>> apart(boxes.size());
  std::vector<std::array<double, 6>> doubles(boxes.size());
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    std::memcpy(apart[k].data(), &boxes[k], sizeof boxes[k]);
    for (std::size_t axis = 0; axis < 6; ++axis) doubles[k].at(axis) = static_cast<double>(apart[k].at(axis));
  }
  broadcl_boxes given = view(boxes);
  given.data = apart.data();
  given.stride = sizeof apart[0];
  EXPECT_EQ(pairs_of(given), expected);
  given.data = &apart.back();
  given.stride = -given.stride;
  EXPECT_EQ(pairs_of(given).size(), expected.size());
  given = view(boxes);
  given.data = doubles.data();
  given.type = BROADCL_FLOAT64;
  given.dimensions = 3;
  EXPECT_EQ(pairs_of(given), expected);
  // 0.1 + 0.2 and 0.3 are one number in single precision.
  const std::array<double, 12> exact{0.1 + 0.2, 0, 0, 1, 1, 1, 0, 0, 0, 0.3, 1, 1};
  given.data = exact.data();
  given.count = 2;
  EXPECT_THAT(pairs_of(given), IsEmpty());
  EXPECT_THAT(pairs_of(view({})), IsEmpty());
}

TEST(CPairList, HasPairsOfTwoSetsAndOfRectangles) {
  const std::vector<broadcl_aabb> boxes = random_boxes(200);
  std::vector<std::array<double, 4>> rectangles;
  std::vector<broadcl_aabb> flat = boxes;
  for (broadcl_aabb& box : flat) {
    box.lower[2] = box.upper[2] = 0;
    std::array<double, 4>& rectangle = rectangles.emplace_back();
    for (std::size_t axis = 0; axis < 2; ++axis) {
      rectangle.at(axis) = static_cast<double>(box.lower[axis]);
      rectangle.at(axis + 2) = static_cast<double>(box.upper[axis]);
    }
  }
  // The first 80 are one set, the others another.
  constexpr std::uint32_t split = 80;
  Pairs expected;
  for (const broadcl_pair& pair : overlapping(flat)) {
    if (pair.a < split && pair.b >= split) expected.push_back({pair.a, pair.b - split});
  }
  ASSERT_GT(expected.size(), 20U);
  broadcl_boxes first = view(flat);
  first.count = split;
  auto second = sized<broadcl_boxes>();
  second.data = &rectangles[split];
  second.count = rectangles.size() - split;
  second.type = BROADCL_FLOAT64;
  second.dimensions = 2;
  const broadcl_config config = on_host();
  broadcl_pair_list* pairs = nullptr;
  OK(broadcl_pair_list_create(&first, &second, nullptr, 0, &config, &pairs));
  broadcl_pairs found{};
  OK(broadcl_pair_list_pairs(pairs, &found));
  EXPECT_EQ(list(found), expected);
  OK(broadcl_pair_list_destroy(pairs));
  second.stride = 7;
  EXPECT_INVALID("second: ", broadcl_pair_list_create, &first, &second, nullptr, 0, &config, &pairs);
}

TEST(CPairList, HasWhatSharesALabel) {
  const std::vector<std::uint32_t> faces = {1, 2, 3, 3, 2, 7};
  const std::vector<std::uint32_t> vertices = {0, 1, 2};
  const auto found = [&](const std::vector<std::uint32_t>& second, std::size_t per_second) {
    broadcl_pair_list* made = nullptr;
    EXPECT_EQ(broadcl_pair_list_create_sharing(faces.data(), faces.size(), 3, second.data(), second.size(),
                                               per_second, &made),
              BROADCL_SUCCESS)
        << broadcl_last_error();
    return taken_from(made);
  };
  EXPECT_THAT(found(vertices, 1), ElementsAre(broadcl_pair{0, 1}, broadcl_pair{0, 2}, broadcl_pair{1, 2}));
  EXPECT_THAT(found({}, 1), IsEmpty());
  EXPECT_THAT(found({}, 0), ElementsAre(broadcl_pair{0, 1}));

  broadcl_pair_list* none = nullptr;
  EXPECT_INVALID("5 labels", broadcl_pair_list_create_sharing, faces.data(), 5, 3, nullptr, 0, 0, &none);
  EXPECT_INVALID("3 labels", broadcl_pair_list_create_sharing, faces.data(), 6, 3, vertices.data(), 3, 0,
                 &none);
  EXPECT_INVALID("labels is null", broadcl_pair_list_create_sharing, nullptr, 6, 3, nullptr, 0, 0, &none);
  EXPECT_INVALID("second_labels is null", broadcl_pair_list_create_sharing, faces.data(), 6, 3, nullptr, 3, 1,
                 &none);
  EXPECT_INVALID("list is null", broadcl_pair_list_create_sharing, faces.data(), 6, 3, nullptr, 0, 0,
                 nullptr);
  EXPECT_EQ(none, nullptr);
}

TEST(CPairList, RefusesBoxesThatAreNone) {
  const std::vector<broadcl_aabb> boxes = {cube(0), cube(nan_value)};
  broadcl_pair_list* pairs = nullptr;
  broadcl_boxes given = view(boxes);
  EXPECT_INVALID("box 1 has a NaN bound", broadcl_pair_list_create, &given, nullptr, nullptr, 0, nullptr,
                 &pairs);
  given.type = 7;
  EXPECT_INVALID("boxes->type is 7", broadcl_pair_list_create, &given, nullptr, nullptr, 0, nullptr, &pairs);
  given = view(boxes);
  given.dimensions = 4;
  EXPECT_INVALID("boxes->dimensions is 4", broadcl_pair_list_create, &given, nullptr, nullptr, 0, nullptr,
                 &pairs);
  given = view(boxes);
  given.stride = 25;
  EXPECT_INVALID("stride", broadcl_pair_list_create, &given, nullptr, nullptr, 0, nullptr, &pairs);
  given = view(boxes);
  given.data = nullptr;
  EXPECT_INVALID("null", broadcl_pair_list_create, &given, nullptr, nullptr, 0, nullptr, &pairs);
  given.size = 0;
  EXPECT_INVALID("boxes->size is 0", broadcl_pair_list_create, &given, nullptr, nullptr, 0, nullptr, &pairs);
  const broadcl_config config = on_host("frobnicate");
  given = view({cube(0)});
  EXPECT_INVALID("frobnicate", broadcl_pair_list_create, &given, nullptr, nullptr, 0, &config, &pairs);
  EXPECT_EQ(pairs, nullptr);
  given = view({});
  OK(broadcl_pair_list_create(&given, nullptr, nullptr, 0, nullptr, &pairs));
  EXPECT_INVALID("pairs is null", broadcl_pair_list_pairs, pairs, nullptr);
  OK(broadcl_pair_list_destroy(pairs));
}

}  // namespace
}  // namespace broadcl::test
