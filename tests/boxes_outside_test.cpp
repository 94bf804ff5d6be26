#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "base/packed_box.hpp"
#include "boxes.hpp"
#include "callers_queue.hpp"
#include "engines/boxes_outside.hpp"
#include "opencl/context.hpp"
#include "runs.hpp"

namespace broadcl::test {
namespace {

SUITE_ALSO_IN(OutsideOnCallersQueue, gpu_profile | rusticl | oclgrind);

class OutsideOnCallersQueue : public testing::Test, protected CallersQueue {
 protected:
  static bool is_outside(const Aabb& inner, const Aabb& box) {
    bool is_within = true;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      is_within = is_within && inner.lower[axis] <= box.lower[axis] && box.upper[axis] <= inner.upper[axis];
    }
    return is_proper(box) && !is_within;
  }

  /// Compares what is found with the definition.
  void check(const std::vector<Aabb>& boxes, const Aabb& inner, bool has_filters) {
    constexpr std::size_t offset = 3;
    constexpr std::size_t stride = 8;
    std::vector<float> floats(offset + boxes.size() * stride);
    std::vector<Filter> filters(has_filters ? boxes.size() : 0);
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      std::memcpy(&floats[offset + k * stride], &boxes[k], sizeof(Aabb));
      if (has_filters) filters[k].world = static_cast<std::uint32_t>(k % 7);
    }
    const cl::Buffer source = buffer_of(floats);
    outside_.begin({.buffer = source, .count = boxes.size(), .offset = offset, .stride = stride},
                   has_filters ? buffer_of(filters) : cl::Buffer(), inner);
    const std::size_t count = outside_.finish();
    std::size_t next = 0;
    for (std::uint32_t k = 0; k < boxes.size(); ++k) {
      if (!is_outside(inner, boxes[k])) continue;
      ASSERT_LT(next, count);
      const BoxesOutside::Found found = outside_[next++];
      ASSERT_EQ(found.index, k);
      ASSERT_TRUE(same_bits(found.box, boxes[k]));
      ASSERT_EQ(found.filter, has_filters ? filters[k] : Filter());
    }
    EXPECT_EQ(next, count);
  }

 private:
  opencl::Context context_{queue_};
  BoxesOutside outside_{context_};
};

TEST_F(OutsideOnCallersQueue, SmallBoxesOfEveryKind) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  constexpr float least = std::numeric_limits<float>::denorm_min();
  const Aabb inner{{0, 0, 0}, {1, 1, 1}};
  const std::vector<Aabb> boxes{
      unit,
      inner,
      {{0, 0, -least}, {1, 1, 1}},
      {{0, 0, 0}, {1, 1 + std::numeric_limits<float>::epsilon(), 1}},
      {{-0.0F, 0, 0}, {1, 1, 1}},
      {{-infinity, 0, 0}, {infinity, 1, 1}},
      empty_aabb(),
      {{2, 0, 0}, {0.5F, 1, 1}},
      {{nan_value, 2, 2}, {3, 3, 3}},
      {{0.5F, 0.5F, 0.5F}, {0.5F, 0.5F, 0.5F}},
      {{5, 5, 5}, {6, 6, 6}},
  };
  check(boxes, inner, false);
  check(boxes, inner, true);
  check(boxes, packed_empty(), true);
  check(boxes, {{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}}, false);
  check({}, inner, false);
}

TEST_F(OutsideOnCallersQueue, MoreThanExpectedAndLessAgain) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> coordinate(0, 1);
  for (const std::size_t n : {100U, 5000U, 20U, 3000U}) {
    std::vector<Aabb> boxes(n);
    for (Aabb& box : boxes) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box.lower[axis] = coordinate(random);
        box.upper[axis] = box.lower[axis] + 0.1F;
      }
    }
    check(boxes, {{0.2F, 0.2F, 0.2F}, {0.4F, 0.4F, 0.4F}}, n < 4000);
    check(boxes, {{0, 0, 0}, {1.05F, 1.05F, 1.05F}}, false);
  }
}

}  // namespace
}  // namespace broadcl::test
