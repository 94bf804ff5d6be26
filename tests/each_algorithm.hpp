#pragma once

#include <algorithm>
#include <cstdint>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "boxes.hpp"
#include "runs.hpp"

namespace broadcl {

// NOLINTNEXTLINE(readability-identifier-naming): with it gtest prints parameters.
inline void PrintTo(const AlgorithmInfo& algorithm, std::ostream* out) {
  *out << algorithm.name;
}

}  // namespace broadcl

namespace broadcl::test {

using Pairs = std::vector<Pair>;

inline bool has_stage(std::span<const Stage> stages, std::string_view name) {
  return std::ranges::any_of(stages, [&](const Stage& stage) { return stage.name == name; });
}

/// Every pair of n objects, in canonical order.
inline Pairs all_pairs(std::uint32_t n) {
  Pairs pairs;
  for (std::uint32_t b = 0; b < n; ++b) {
    for (std::uint32_t a = 0; a < b; ++a) pairs.push_back({a, b});
  }
  return pairs;
}

inline Pairs to_vector(std::span<const Pair> pairs) {
  return {pairs.begin(), pairs.end()};
}

/// Whether the device is one on which large tests take minutes.
inline bool is_slow_device() {
  const std::string platform = select_device().platform_name;
  return platform.find("rusticl") != std::string::npos || platform.find("Oclgrind") != std::string::npos;
}

/// Oclgrind interprets kernels in the rounding mode of the calling thread, which no device knows.
inline bool is_oclgrind() {
  return select_device().platform_name.find("Oclgrind") != std::string::npos;
}

/// Whether AddressSanitizer watches, which needs few objects to see what they do.
#ifdef __has_feature
inline constexpr bool is_sanitized = __has_feature(address_sanitizer);
#else
inline constexpr bool is_sanitized = false;
#endif

/// Tests of this suite run over every algorithm of the table (broad_phase_test.cpp).
class EachAlgorithm : public ::testing::TestWithParam<AlgorithmInfo> {
 protected:
  [[nodiscard]] static BroadPhase::Config config() { return {.algorithm = std::string(GetParam().name)}; }

  static void expect_oracle(std::span<const Aabb> boxes, const std::string& what) {
    EXPECT_EQ(overlapping_pairs(boxes, {}, config()), overlapping_pairs(boxes, {}, {.algorithm = "oracle"}))
        << what;
  }

  [[nodiscard]] static bool is_slow() { return is_sanitized || (GetParam().on_device && is_slow_device()); }
};

SUITE_ALSO_IN(EachAlgorithm, gpu_profile | rusticl);

/// The same in the long run only.
using LongEachAlgorithm = EachAlgorithm;

/// Those of the table that may use a device.
inline std::vector<AlgorithmInfo> device_algorithms() {
  std::vector<AlgorithmInfo> rows(algorithms().begin(), algorithms().end());
  std::erase_if(rows, [](const AlgorithmInfo& row) { return !row.on_device; });
  return rows;
}

/// Tests of this suite run over these.
class EachDeviceAlgorithm : public EachAlgorithm {};
SUITE_ALSO_IN(EachDeviceAlgorithm, gpu_profile | rusticl);

/// Whether two lists are equal, or the first difference: printing them would take long.
inline ::testing::AssertionResult same(std::string_view what, std::span<const Pair> is,
                                       std::span<const Pair> expected) {
  const auto wrong = std::mismatch(is.begin(), is.end(), expected.begin(), expected.end());
  if (wrong.first == is.end() && wrong.second == expected.end()) return ::testing::AssertionSuccess();
  const auto text = [](auto place, auto end) {
    return place == end ? "the end" : "(" + std::to_string(place->a) + ", " + std::to_string(place->b) + ")";
  };
  return ::testing::AssertionFailure()
         << what << ": " << is.size() << " pairs, expected " << expected.size() << "; at "
         << wrong.first - is.begin() << " is " << text(wrong.first, is.end()) << ", expected "
         << text(wrong.second, expected.end());
}

inline ::testing::AssertionResult same(const Delta& is, std::span<const Pair> added,
                                       std::span<const Pair> removed) {
  const ::testing::AssertionResult result = same("added", is.added, added);
  return result ? same("removed", is.removed, removed) : result;
}

}  // namespace broadcl::test
