#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/opencl.hpp>

#include "callers_queue.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "test_name.hpp"

/// Unusable buffers and queues of the caller are refused by the call that gets them, which changes nothing.
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

class CallersBuffers : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Table, CallersBuffers, ::testing::Values("brute-force", "tiles"),
                         named_by_parameter);

TEST_P(CallersBuffers, ThatCannotBeUsedAreRefusedAndNothingChanges) {
  constexpr std::size_t most = std::numeric_limits<std::size_t>::max();
  const CallersQueue queue;
  const CallersQueue foreign;
  const cl::Buffer boxes = queue.buffer_of(std::vector<Aabb>(10, unit));
  const cl::Buffer filters = queue.buffer_of(std::vector<Filter>(10));
  const cl::Buffer few_filters = queue.buffer_of(std::vector<Filter>(9));
  const cl::Buffer foreign_boxes = foreign.buffer_of(std::vector<Aabb>(10, unit));
  const cl::Buffer foreign_filters = foreign.buffer_of(std::vector<Filter>(10));
  struct Row {
    std::string what;
    DeviceBroadPhase::Boxes boxes;
    std::string error;
  };
  const std::vector<Row> rows{
      {"boxes of another context", {.buffer = foreign_boxes(), .count = 10}, "context"},
      {"filters of another context",
       {.buffer = boxes(), .count = 10, .filters = foreign_filters()},
       "context"},
      {"no boxes", {.buffer = nullptr, .count = 10}, "null"},
      {"one box too many", {.buffer = boxes(), .count = 11}, "240 bytes, too few for 11"},
      {"the last box ends outside", {.buffer = boxes(), .count = 10, .offset = 4}, "bytes"},
      {"a stride that is too long", {.buffer = boxes(), .count = 10, .stride = 28}, "bytes"},
      {"a filter too few", {.buffer = boxes(), .count = 10, .filters = few_filters()}, "filters"},
      {"more boxes than there are ids", {.buffer = boxes(), .count = most / 24}, "2147483647"},
      {"a last box that wraps around", {.buffer = boxes(), .count = 3, .stride = most / 2 + 1}, "bytes"},
      {"an offset that wraps around", {.buffer = boxes(), .count = 1, .offset = most - 3}, "bytes"},
      {"both", {.buffer = boxes(), .count = 2, .offset = most - 23, .stride = most - 23}, "bytes"},
      {"a crooked offset", {.buffer = boxes(), .count = 1, .offset = 2}, "multiples of 4"},
      {"a crooked stride", {.buffer = boxes(), .count = 2, .stride = 26}, "multiples of 4"},
  };
  DeviceBroadPhase broad_phase(queue(), {.algorithm = GetParam()});
  broad_phase.update({.buffer = boxes(), .count = 8});
  for (const Row& row : rows) {
    SCOPED_TRACE(row.what);
    const std::string error = error_of([&] { broad_phase.begin(row.boxes); });
    EXPECT_THAT(error, HasSubstr(row.error));
    if (error.empty()) broad_phase.finish();
    EXPECT_TRUE(same("pairs", queue.read(broad_phase.pairs()), all_pairs(8)));
    const auto result = broad_phase.update({.buffer = boxes(), .count = 8});
    EXPECT_EQ(result.added.count + result.removed.count, 0U);
  }
}

TEST(CallersQueues, WithoutProfilingAreRefusedIfTimesAreAskedFor) {
  const CallersQueue queue;
  EXPECT_THAT(error_of([&] { DeviceBroadPhase broad_phase(queue(), {.profile = true}); }),
              HasSubstr("profil"));
}

}  // namespace
}  // namespace broadcl::test
