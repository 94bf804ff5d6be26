#include "engines/pair_delta.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/aabb.hpp>

#include "each_algorithm.hpp"
#include "engines/device_objects.hpp"
#include "engines/engine.hpp"
#include "environment.hpp"
#include "expect_error.hpp"

namespace broadcl {
namespace {

SUITE_ALSO_IN(PairDelta, gpu_profile | rusticl);
SUITE_ALSO_IN(Objects, gpu_profile | rusticl);

using ::testing::HasSubstr;

/// A finder whose pairs are those of a given kernel.
class FoundBy final : public PairFinder {
 public:
  using Enqueue = std::function<void(const Search&, const PairDelta&)>;
  explicit FoundBy(Enqueue enqueue) : enqueue_(std::move(enqueue)) {}

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& /*profiler*/) override {
    enqueue_(search, sink);
  }

 private:
  Enqueue enqueue_;
};

/// The device's memory runs out in the middle of a frame: an error with the numbers. The pairs of the last
/// frame are known as before, so that the next, smaller frame has the right changes.
NOT_IN(gpu_profile | sanitizers, "takes gigabytes");
TEST(PairDelta, ExhaustedMemoryLeavesTheLastFrameKnown) {
  constexpr cl_uint n = 600;
  Device device = select_device();
  device.max_allocation = 1 << 20;  // 131,072 pairs fit, 179,700 do not
  opencl::forget_opened_devices();  // which are described otherwise
  const opencl::Context context(device, false);
  opencl::forget_opened_devices();
  opencl::Profiler profiler(false);
  Engine engine(context, profiler, make_brute_force, Order::Target::host);
  DeviceObjects objects(context, profiler, engine.frames());
  objects.reserve(n, false);
  const auto update = [&] {
    engine.prepare();
    engine.begin(objects.upload({.boxes = objects.boxes().first(n), .changed = {.all = true}}));
    engine.search();
    const PairDelta::Counts counts = engine.finish();
    objects.commit();
    return engine.changes().on_host(counts);
  };
  const auto place = [&](cl_uint together) {
    for (cl_uint k = 0; k < n; ++k) {
      const float x = k < together ? 0 : 2 * static_cast<float>(k);
      objects.boxes()[k] = {{x, 0, 0}, {x + 1, 1, 1}};
    }
  };

  place(20);
  EXPECT_EQ(update().added.size(), 190U);
  place(n);
  EXPECT_THAT(test::error_of([&] { update(); }), HasSubstr("1048576"));
  EXPECT_EQ(engine.pairs().size(), 190U);
  place(19);
  const Delta changes = update();
  EXPECT_TRUE(changes.added.empty());
  EXPECT_EQ(changes.removed.size(), 19U);
  EXPECT_EQ(engine.pairs().size(), 171U);
}

/// A list that fits the device's largest allocation is not refused because it cannot grow further. With
/// memory for one pair less, it is too short.
TEST(PairDelta, AListMayBeAsLargeAsTheLargestAllocation) {
  constexpr cl_uint n = 512;
  constexpr std::size_t pairs = n * (n - 1) / 2;
  for (const std::size_t missing : {0U, 1U}) {
    Device device = select_device();
    device.max_allocation = (pairs - missing) * sizeof(Pair);
    opencl::forget_opened_devices();  // which are described otherwise
    const opencl::Context context(device, false);
    opencl::forget_opened_devices();
    opencl::Profiler profiler(false);
    Engine engine(context, profiler, make_brute_force, Order::Target::device);
    DeviceObjects objects(context, profiler, engine.frames());
    objects.reserve(n, false);
    std::ranges::fill(objects.boxes().first(n), test::unit);
    objects.boxes()[0] = {{-1, 0, 0}, {0, 1, 1}};  // touches the others
    const auto update = [&] {
      engine.prepare();
      engine.begin(objects.upload({.boxes = objects.boxes().first(n), .changed = {.all = true}}));
      engine.search();
      const std::size_t found = engine.finish().found;
      objects.commit();
      return found;
    };
    objects.boxes()[n - 1].lower[0] = 0.5F;  // all but the last one
    EXPECT_EQ(update(), pairs - 1);
    objects.boxes()[n - 1].lower[0] = 0;
    if (missing > 0) {
      EXPECT_THAT(test::error_of(update), HasSubstr("overlapping pairs"));
    } else {
      EXPECT_EQ(update(), pairs);
      EXPECT_TRUE(test::same("pairs", engine.pairs(), test::all_pairs(n)));
    }
  }
}

/// Pairs are counted with 64 bits, so that more than 32 bits can count cause an error instead of a few pairs.
TEST(PairDelta, MorePairsThan32BitsCountAreAnError) {
  const test::ScopedFolder folder;
  std::filesystem::copy(BROADCL_KERNEL_FOLDER, folder.path());
  std::ofstream(folder.path() / "reserve.cl") << R"(
#include "delta.h"
kernel void reserve(const uint times, PAIR_SINK_PARAMETERS) {
  const pair_sink_t sink = PAIR_SINK;
  for (uint k = 0; k < times; ++k) {
    const uint base = reserve_pairs(&sink, 1U << 30);
    for (uint i = 0; i < 3; ++i) append_pair(&sink, base, i, (uint2)(k, 100 + i));
  }
}
)";
  const test::ScopedVariable variable("BROADCL_KERNEL_DIR", folder.path().string());
  const opencl::Context context(select_device(), false);
  opencl::Profiler profiler(false);
  Engine engine(
      context, profiler,
      [](const opencl::Context& in) -> std::unique_ptr<PairFinder> {
        return std::make_unique<FoundBy>([&in](const Search& search, const PairDelta& sink) {
          cl::Kernel kernel(in.program("reserve.cl"), "reserve");
          kernel.setArg(0, cl_uint{40});
          sink.set_sink(kernel, 1, search);
          in.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(1), cl::NDRange(1));
        });
      },
      Order::Target::host);
  DeviceObjects objects(context, profiler, engine.frames());
  objects.reserve(200, false);
  engine.prepare();
  engine.begin(objects.upload({.boxes = objects.boxes().first(200), .changed = {.all = true}}));
  engine.search();
  EXPECT_THAT(test::error_of([&] { (void)engine.finish(); }), HasSubstr("more than 2147483648 pairs"));
  EXPECT_TRUE(engine.pairs().empty());
}

/// The device counts complete frames with 32 bits.
TEST(PairDelta, IncompleteFramesAreCountedBeyond32Bits) {
  constexpr std::uint64_t wrap = std::uint64_t{1} << 32U;
  for (const std::uint64_t complete : {std::uint64_t{0}, wrap - 1, wrap, wrap + 1, 5 * wrap + 3}) {
    for (const std::uint64_t incomplete : {0U, 1U, 7U}) {
      const auto settled =
          PairDelta::settled_of(complete + incomplete, static_cast<cl_uint>(complete), cl_uint{9});
      EXPECT_EQ(settled.complete, complete);
      EXPECT_EQ(settled.frames - settled.complete, incomplete);
      EXPECT_EQ(settled.tag, 9U);
    }
  }
}

/// The device's copy of the objects: only changes cross the bus. If memory grew, all objects are copied to
/// it.
class Objects : public ::testing::Test {
 protected:
  template <class Item>
  std::vector<Item> read(const cl::Buffer& buffer, std::size_t n) {
    std::vector<Item> items(n);
    if (n > 0) context_.queue().enqueueReadBuffer(buffer, CL_TRUE, 0, n * sizeof(Item), items.data());
    return items;
  }
  /// Boxes on the device after an update; before it, they must be those given.
  std::vector<Aabb> update(const Input& input, const std::vector<Aabb>& before) {
    const Search search = objects_.upload(input);
    EXPECT_EQ(read<Aabb>(search.last.boxes, search.last.slots), before);
    std::vector<Aabb> boxes = read<Aabb>(search.now.boxes, search.now.slots);
    commit();
    return boxes;
  }

  void commit() {
    frames_.swap();
    objects_.commit();
  }

  opencl::Context context_{select_device(), false};
  opencl::Profiler profiler_{false};
  Frames frames_;
  DeviceObjects objects_{context_, profiler_, frames_};
};

TEST_F(Objects, OnlyWhatChangedCrossesTheBus) {
  constexpr std::uint32_t n = 100;
  objects_.reserve(n, false);
  std::vector<Aabb> expected(n);
  for (std::uint32_t k = 0; k < n; ++k) expected[k] = objects_.boxes()[k] = test::apart(k);
  EXPECT_EQ(update({.boxes = objects_.boxes().first(n), .changed = {.all = true}}, {}), expected);
  for (std::uint32_t k = 0; k < n; ++k) objects_.boxes()[k] = test::unit;
  for (const std::array<std::uint32_t, 3> changed :
       {std::array{71U, 0U, 99U}, {5U, 71U, 98U}, {1U, 2U, 3U}}) {
    const std::vector<Aabb> before = expected;
    for (const std::uint32_t slot : changed) expected[slot] = test::unit;
    EXPECT_EQ(update({.boxes = objects_.boxes().first(n), .changed = {.slots = changed}}, before), expected);
  }
  EXPECT_EQ(update({.boxes = objects_.boxes().first(n), .changed = {.all = true}}, expected),
            std::vector<Aabb>(n, test::unit));
}

TEST_F(Objects, AnUpdateThatDoesNotSucceedLeavesTheLastOne) {
  constexpr std::uint32_t n = 10;
  objects_.reserve(n, false);
  for (std::uint32_t k = 0; k < n; ++k) objects_.boxes()[k] = test::apart(k);
  const std::vector<Aabb> before = update({.boxes = objects_.boxes().first(n), .changed = {.all = true}}, {});
  for (std::uint32_t k = 0; k < n; ++k) objects_.boxes()[k] = test::unit;
  const std::array<std::uint32_t, 2> changed{3, 4};
  (void)objects_.upload({.boxes = objects_.boxes().first(n), .changed = {.slots = changed}});
  EXPECT_EQ(update({.boxes = objects_.boxes().first(n), .changed = {.all = true}}, before),
            std::vector<Aabb>(n, test::unit));
}

TEST_F(Objects, NewFiltersComeAlongAndThoseOfTheLastUpdateStay) {
  std::vector<Filter> filters;
  std::vector<Filter> before;
  const auto expect_uploaded = [&](bool changed) {
    std::vector<std::uint32_t> added(filters.size() - before.size());
    std::iota(added.begin(), added.end(), static_cast<std::uint32_t>(before.size()));
    const Search search = objects_.upload({.boxes = objects_.boxes().first(filters.size()),
                                           .changed = {.all = true, .recycled = added},
                                           .rules = {.filters = filters, .all_changed = changed}});
    EXPECT_EQ(read<Filter>(search.now.filters, filters.size()), filters);
    EXPECT_EQ(search.last.filters() != nullptr, !before.empty());
    EXPECT_EQ(read<Filter>(search.last.filters, before.size()), before);
    commit();
    before = filters;
  };
  for (std::uint32_t n = 1; n < 600; n += 1 + n / 2) {
    objects_.reserve(n, true);
    while (filters.size() < n) filters.push_back({.body = static_cast<std::uint32_t>(filters.size())});
    expect_uploaded(n == 1);
  }
  for (std::uint32_t k = 0; k < 3; ++k) {  // few
    filters.push_back({.body = k});
    expect_uploaded(false);
  }
  filters[3].mask = 0;
  expect_uploaded(true);
  expect_uploaded(false);
  filters[4].mask = 0;
  expect_uploaded(true);
}

TEST_F(Objects, OnlyFiltersThatChangedCrossTheBus) {
  constexpr std::uint32_t n = 100;
  objects_.reserve(n, true);
  const std::vector<Filter> wrong(n, {.mask = 0});
  std::vector<Filter> before(n, {.body = 1});
  const auto expect_uploaded = [&](const std::vector<Filter>& given, std::span<const std::uint32_t> changed,
                                   bool all) {
    std::vector<Filter> expected = all ? given : before;
    for (const std::uint32_t slot : changed) expected[slot] = given[slot];
    const Search search =
        objects_.upload({.boxes = objects_.boxes().first(n),
                         .changed = {.all = true},
                         .rules = {.filters = given, .all_changed = all, .refiltered = changed}});
    EXPECT_EQ(read<Filter>(search.now.filters, n), expected);
    if (search.last.slots > 0) {
      EXPECT_EQ(read<Filter>(search.last.filters, n), before);
    }
    before = expected;
  };
  expect_uploaded(before, {}, true);
  commit();
  std::array<std::uint32_t, 3> last{};
  for (std::uint32_t frame = 0; frame < 12; ++frame) {
    if (frame == 6) {  // fails, so the next one has all of them
      std::vector<Filter> given = wrong;
      for (const std::uint32_t slot : last) given[slot] = before[slot];
      expect_uploaded(given, std::array{1U, 2U}, false);
      before = std::vector<Filter>(n, {.body = 5});
      const Search search = objects_.upload({.boxes = objects_.boxes().first(n),
                                             .changed = {.all = true},
                                             .rules = {.filters = before, .all_changed = true}});
      EXPECT_EQ(read<Filter>(search.now.filters, n), before);
      commit();
    }
    // What changed last is uploaded again.
    std::vector<Filter> given = wrong;
    for (const std::uint32_t slot : last) given[slot] = before[slot];
    const std::array changed{frame, 20 + frame % 2, n - 1};
    for (const std::uint32_t slot : changed) given[slot].world = frame;
    expect_uploaded(given, frame % 4 == 3 ? std::span<const std::uint32_t>() : changed, false);
    commit();
    if (frame % 4 != 3) last = changed;
  }
}

}  // namespace
}  // namespace broadcl
