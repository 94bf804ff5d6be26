#pragma once

#include <broadcl/broadcl.h>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <ostream>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

// For tests of the C interface and of nothing else of the library: they are linked against the shared one, if
// that is built.

inline bool operator==(const broadcl_pair& s, const broadcl_pair& t) {
  return s.a == t.a && s.b == t.b;
}
inline std::ostream& operator<<(std::ostream& stream, const broadcl_pair& pair) {
  return stream << "(" << pair.a << ", " << pair.b << ")";
}

namespace broadcl::test {

using Pairs = std::vector<broadcl_pair>;

inline constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();

/// A struct that begins with its size, all default.
template <class Struct>
Struct sized() {
  Struct result{};
  result.size = sizeof(Struct);
  return result;
}

inline broadcl_config on_host(const char* algorithm = "sweep-and-prune") {
  auto config = sized<broadcl_config>();
  config.algorithm = algorithm;
  return config;
}

inline broadcl_aabb cube(float x) {
  return {{x, 0, 0}, {x + 1, 1, 1}};
}

inline broadcl_boxes view(const std::vector<broadcl_aabb>& boxes) {
  auto result = sized<broadcl_boxes>();
  result.data = boxes.data();
  result.count = boxes.size();
  return result;
}

inline broadcl_boxes view_of_one(const broadcl_aabb& box) {
  auto result = sized<broadcl_boxes>();
  result.data = &box;
  result.count = 1;
  return result;
}

inline Pairs list(const broadcl_pairs& pairs) {
  return {pairs.data, pairs.data + pairs.count};
}

inline std::vector<broadcl_aabb> random_boxes(std::size_t n) {
  std::mt19937 random(7);
  const auto number = [&] { return static_cast<float>(random() % 1000) / 100; };
  std::vector<broadcl_aabb> boxes(n);
  for (broadcl_aabb& box : boxes) {
    for (int axis = 0; axis < 3; ++axis) {
      box.lower[axis] = number();
      box.upper[axis] = box.lower[axis] + number() / 4;
    }
  }
  return boxes;
}

inline Pairs overlapping(const std::vector<broadcl_aabb>& boxes) {
  Pairs pairs;
  for (std::uint32_t b = 0; b < boxes.size(); ++b) {
    for (std::uint32_t a = 0; a < b; ++a) {
      bool overlaps = true;
      for (int axis = 0; axis < 3; ++axis) {
        overlaps = overlaps && boxes[a].lower[axis] <= boxes[b].upper[axis] &&
                   boxes[b].lower[axis] <= boxes[a].upper[axis];
      }
      if (overlaps) pairs.push_back({a, b});
    }
  }
  return pairs;
}

inline void expect_refused(broadcl_status status, broadcl_status expected, const std::string& function,
                           const std::string& text) {
  EXPECT_EQ(status, expected);
  EXPECT_THAT(broadcl_last_error(), ::testing::StartsWith(function + ": "));
  EXPECT_THAT(broadcl_last_error(), ::testing::HasSubstr(text));
}

/// Calls a function whose name its error must begin with.
#define EXPECT_REFUSED(expected, text, function, ...) \
  expect_refused(function(__VA_ARGS__), expected, #function, text)
#define EXPECT_INVALID(text, function, ...) \
  EXPECT_REFUSED(BROADCL_INVALID_ARGUMENT, text, function, __VA_ARGS__)
#define EXPECT_FAILED(text, function, ...) EXPECT_REFUSED(BROADCL_FAILED, text, function, __VA_ARGS__)
#define OK(call) ASSERT_EQ(call, BROADCL_SUCCESS) << broadcl_last_error()

}  // namespace broadcl::test
