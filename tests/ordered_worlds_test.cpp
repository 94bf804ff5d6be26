#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "device_life.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "scenes/generators.hpp"

/// Changes on the device, in the order of their worlds.
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

/// A list with the index at which each world begins.
struct ByWorld {
  Pairs pairs;
  std::vector<std::uint32_t> offsets;
};

class OrderedWorlds : public ::testing::Test, protected CallersQueue {
 protected:
  [[nodiscard]] static ByWorld by_world(std::span<const Pair> canonical, const std::vector<Filter>& filters,
                                        std::uint32_t worlds) {
    const auto world_of = [&](const Pair& pair) {
      const std::uint32_t world = filters[pair.b].world;
      return std::min(worlds, world != Filter::all_worlds ? world : filters[pair.a].world);
    };
    ByWorld result{.pairs = to_vector(canonical), .offsets = {}};
    std::ranges::stable_sort(result.pairs, {}, world_of);
    for (std::uint32_t world = 0; world < worlds + 2; ++world) {
      const auto begin = std::ranges::lower_bound(result.pairs, world, {}, world_of);
      result.offsets.push_back(static_cast<std::uint32_t>(begin - result.pairs.begin()));
    }
    return result;
  }

  [[nodiscard]] std::vector<std::uint32_t> read_offsets(cl_mem offsets, std::uint32_t worlds) const {
    std::vector<std::uint32_t> words(worlds + 2);
    queue_.enqueueReadBuffer(cl::Buffer(offsets, true), CL_TRUE, 0, words.size() * sizeof(std::uint32_t),
                             words.data());
    return words;
  }

  void expect(const DeviceBroadPhase::PairBuffer& list, const ByWorld& expected) const {
    EXPECT_TRUE(same("list", read(list), expected.pairs));
    EXPECT_EQ(read_offsets(list.offsets, static_cast<std::uint32_t>(expected.offsets.size() - 2)),
              expected.offsets);
  }

  /// Moves boxes over some frames and waits for every third only.
  void follow_oracle(std::uint32_t n, std::uint32_t worlds, int frames) {
    scenes::MovingBoxes motion(n, scenes::MovingBoxes::Sizes::mixed);
    DeviceBroadPhase broad_phase(queue_(), {.algorithm = "tiles"});
    broad_phase.reserve(n, std::size_t{n} * 40, true);
    BroadPhase oracle({.algorithm = "oracle"});
    std::vector<Filter> filters(n);
    std::vector<Filter> last_filters;
    for (int frame = 0; frame < frames; ++frame) {
      motion.advance();
      const std::vector<Aabb> boxes(motion.boxes().begin(), motion.boxes().end());
      for (std::uint32_t k = 0; k < n; ++k) {
        // Some are in all worlds, some in worlds beyond the ordered ones, and some change.
        const std::uint32_t shift = k % 50 == 0 ? static_cast<std::uint32_t>(frame) : 0U;
        filters[k].world = k % 11 == 3 ? Filter::all_worlds : (k + shift) % (worlds + 2);
      }
      std::ranges::copy(boxes, oracle.map(n).begin());
      for (std::uint32_t k = 0; k < n; ++k) oracle.set_filter(k, filters[k]);
      const Delta delta = oracle.update();
      const ByWorld added = by_world(delta.added, filters, worlds);
      const ByWorld removed = by_world(delta.removed, last_filters, worlds);

      const cl::Buffer box_buffer = buffer_of(boxes);
      const cl::Buffer filter_buffer = buffer_of(filters);
      const DeviceBroadPhase::Boxes given{.buffer = box_buffer(),
                                          .count = n,
                                          .filters = filter_buffer(),
                                          .worlds = true,
                                          .ordered_worlds = worlds};
      if (frame % 3 == 0) {
        const auto result = broad_phase.update(given);
        expect(result.added, added);
        expect(result.removed, removed);
      } else {
        const std::size_t capacity = std::size_t{40} * n;
        const cl::Buffer added_pairs = buffer_of(Pairs(capacity));
        const cl::Buffer removed_pairs = buffer_of(Pairs(capacity));
        const cl::Buffer counts = buffer_of(std::vector<std::uint32_t>(4));
        const cl::Buffer added_offsets = buffer_of(std::vector<std::uint32_t>(worlds + 2));
        const cl::Buffer removed_offsets = buffer_of(std::vector<std::uint32_t>(worlds + 2));
        broad_phase.enqueue(given, {.added = added_pairs(),
                                    .removed = removed_pairs(),
                                    .capacity = capacity,
                                    .counts = counts(),
                                    .added_offsets = added_offsets(),
                                    .removed_offsets = removed_offsets()});
        const auto words = read_counts(counts);
        ASSERT_EQ(words[3], 0U);
        expect({added_pairs(), words[0], added_offsets()}, added);
        expect({removed_pairs(), words[1], removed_offsets()}, removed);
      }
      if (HasFailure()) FAIL() << "frame " << frame;
      last_filters = filters;
    }
  }
};

SUITE_ALSO_IN(OrderedWorlds, gpu_profile | rusticl);

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST_F(OrderedWorlds, SmallOnesFollowTheOracle) {
  follow_oracle(90, 3, 4);
}

TEST_F(OrderedWorlds, FollowTheOracle) {
  follow_oracle(1000, 15, 7);
}

TEST_F(OrderedWorlds, AsManyAsObjects) {
  follow_oracle(400, 400, 4);
}

/// One world has more changes than are sorted by comparing each with every other.
TEST_F(OrderedWorlds, ManyChangesInOne) {
  constexpr std::uint32_t n = 150;
  const cl::Buffer boxes = buffer_of(std::vector<Aabb>(n, unit));
  std::vector<Filter> filters(n);
  for (std::uint32_t k = 0; k < 20; ++k) filters[k].world = 1;
  const cl::Buffer filter_buffer = buffer_of(filters);
  DeviceBroadPhase broad_phase(queue_());
  const auto result = broad_phase.update(
      {.buffer = boxes(), .count = n, .filters = filter_buffer(), .worlds = true, .ordered_worlds = 2});
  BroadPhase oracle({.algorithm = "oracle"});
  for (const Filter& filter : filters) oracle.add(unit, filter);
  const ByWorld expected = by_world(oracle.update().added, filters, 2);
  ASSERT_GT(expected.offsets[1], 4096U);
  expect(result.added, expected);
  EXPECT_EQ(broad_phase.update({.buffer = boxes(), .count = 0, .ordered_worlds = 2}).removed.count,
            expected.pairs.size());
}

TEST_F(OrderedWorlds, BuffersForOffsetsAreChecked) {
  const cl::Buffer boxes = buffer_of(std::vector<Aabb>(10, unit));
  const cl::Buffer pairs = buffer_of(Pairs(45));
  const cl::Buffer counts = buffer_of(std::vector<std::uint32_t>(4));
  DeviceBroadPhase broad_phase(queue_());
  broad_phase.reserve(10, 45);
  DeviceBroadPhase::ChangeBuffers changes{
      .added = pairs(), .removed = pairs(), .capacity = 45, .counts = counts(), .added_offsets = counts()};
  EXPECT_THAT(
      error_of([&] { broad_phase.enqueue({.buffer = boxes(), .count = 10, .ordered_worlds = 2}, changes); }),
      HasSubstr("removed offsets is null"));
  changes.removed_offsets = counts();
  EXPECT_THAT(
      error_of([&] { broad_phase.enqueue({.buffer = boxes(), .count = 10, .ordered_worlds = 3}, changes); }),
      HasSubstr("added offsets has 16 bytes, too few for 5"));
}

}  // namespace
}  // namespace broadcl::test
