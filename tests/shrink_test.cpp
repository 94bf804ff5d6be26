#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iostream>
#include <new>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/opencl.hpp>

#include "callers_queue.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "forked_child.hpp"
#include "patience.hpp"
#include "process_memory.hpp"
#include "runs.hpp"

/// Memory after an update that needed far more than others.
namespace broadcl::test {
namespace {

/// More objects, at one place, for one update; and their end.
void do_spike(BroadPhase& broad_phase, std::uint32_t objects) {
  std::vector<std::uint32_t> ids;
  for (std::uint32_t k = 0; k < objects; ++k) ids.push_back(broad_phase.add({{-9, 0, 0}, {-8, 1, 1}}));
  (void)broad_phase.update();
  for (const std::uint32_t id : ids) broad_phase.remove(id);
  (void)broad_phase.update();
}

TEST_P(EachAlgorithm, ShrinkGivesMemoryBackAndChangesNothingElse) {
  constexpr std::uint32_t few = 300;
  const std::uint32_t many = is_slow() ? 600 : 3000;
  BroadPhase broad_phase(config());
  BroadPhase other({.algorithm = "oracle"});
  const auto both = [&](const auto& function) {
    function(broad_phase);
    function(other);
  };
  const auto expect_same_update = [&] {
    const Delta expected = other.update();
    const Delta delta = broad_phase.update();
    EXPECT_TRUE(same(delta, expected.added, expected.removed));
    EXPECT_TRUE(same("pairs", broad_phase.pairs(), other.pairs()));
  };
  both([](BroadPhase& one) {
    for (std::uint32_t k = 0; k < few; ++k) one.add(apart(k % 100), {.group = 1 + k % 2, .mask = 3});
    one.set_exclusions(std::vector<Pair>{{0, 100}});
  });
  expect_same_update();
  const std::size_t before = broad_phase.memory().device;
  broad_phase.shrink();
  do_spike(broad_phase, many);
  do_spike(other, many);
  const std::size_t most = broad_phase.memory().device;
  EXPECT_TRUE(most == 0 || most > 2 * before);
  both([](BroadPhase& one) {
    one.add(apart(5));
    one.remove(3);  // changes that the next update is to find
  });
  broad_phase.shrink();
  EXPECT_TRUE(eventually([&] { return broad_phase.memory().device <= before + before / 2; }));
  EXPECT_EQ(broad_phase.size(), other.size());
  EXPECT_TRUE(same("pairs", broad_phase.pairs(), other.pairs()));
  expect_same_update();
  broad_phase.shrink();
  broad_phase.shrink();
  both([](BroadPhase& one) {
    EXPECT_EQ(one.add(apart(7)), 3U);
    EXPECT_EQ(one.add(apart(7)), few + 1);
    one.move(8, apart(9));
    one.set_filter(9, {.mask = 0});
  });
  expect_same_update();
  broad_phase.begin();
  EXPECT_NE(error_of([&] { broad_phase.shrink(); }).find("finish()"), std::string::npos);
  (void)broad_phase.finish();
  both([](BroadPhase& one) {
    one.map(10);
    one.remove(9);
  });
  broad_phase.shrink();
  expect_same_update();
  both([](BroadPhase& one) { one.map(0); });
  expect_same_update();
  broad_phase.shrink();
  expect_same_update();
}

/// Objects of the second set keep their own numbers.
TEST(DeviceMemory, ShrinksWithTwoSets) {
  const CallersQueue queue;
  DeviceBroadPhase broad_phase(queue());
  const cl::Buffer boxes = queue.buffer_of(std::vector<Aabb>(2, unit));
  (void)broad_phase.update({.buffer = boxes(), .count = 2, .second = {.buffer = boxes(), .count = 1}});
  const Pairs expected{{0, 0}, {1, 0}};
  EXPECT_EQ(queue.read(broad_phase.pairs()), expected);
  broad_phase.shrink();
  EXPECT_EQ(queue.read(broad_phase.pairs()), expected);
}

#ifdef __GLIBC__
NOT_IN(sanitizers, "which keep freed memory");
TEST(HostMemory, IsGivenBackToTheSystem) {
  // In a child without other threads: the free end of their memory would not be given back.
  EXPECT_TRUE(holds_in_child([] {
    BroadPhase broad_phase({.algorithm = "sweep-and-prune", .threads = 1});
    do_spike(broad_phase, 100);
    broad_phase.shrink();
    const std::size_t before = ProcessMemory::now().resident;
    do_spike(broad_phase, 5000);  // 100 MB of pairs
    EXPECT_GT(ProcessMemory::now().resident, before + (std::size_t{90} << 20U));
    broad_phase.shrink();
    EXPECT_LT(ProcessMemory::now().resident, before + (std::size_t{4} << 20U));
  }));
}
#endif

NOT_IN(all_default | sanitizers, "takes long, and sanitizers need addresses");
TEST(HostMemory, SufficesAgainAfterARealShortage) {
  EXPECT_TRUE(holds_in_child([] {
    constexpr std::uint32_t n = 40'000;
    limit_memory(std::size_t{1} << 30U);
    // Each thread has 64 MB of addresses for itself.
    BroadPhase broad_phase({.algorithm = "sweep-and-prune", .threads = 2});
    for (std::uint32_t id = 0; id < n; ++id) broad_phase.add(apart(id));
    for (int k = 0; k < 2; ++k) {
      for (std::uint32_t id = 0; id < n; ++id) broad_phase.move(id, unit);
      EXPECT_THROW(broad_phase.update(), std::bad_alloc);
      EXPECT_THROW(broad_phase.update(), std::bad_alloc);
      for (std::uint32_t id = 0; id < n; ++id) broad_phase.move(id, apart(id % 9000));
      const std::size_t added = broad_phase.update().added.size();
      EXPECT_EQ(added, k == 0 ? 4000U * 10 + 5000U * 6 : 0U);
      EXPECT_EQ(broad_phase.pairs().size(), 4000U * 10 + 5000U * 6);
      EXPECT_NO_THROW(std::vector<char>(std::size_t{500} << 20U)) << "it keeps memory";
    }
  }));
}

/// Bytes that a function adds to those in memory, now and at most. (Large pages would count whole.)
struct Added {
  double now, peak;
};
template <class Function>
Added bytes_of(const Function& function) {
  const auto before = static_cast<double>(ProcessMemory::now().resident);
  ProcessMemory::reset_peak();
  function();
  return {static_cast<double>(ProcessMemory::now().resident) - before,
          static_cast<double>(ProcessMemory::peak()) - before};
}

/// The figures of docs/algorithms.md, which this prints.
NOT_IN(all_default | sanitizers, "takes long, and sanitizers need more");
TEST(HostMemory, IsAsDocumented) {
  const auto print = [](const char* what, Added bytes, double per) {
    std::cout << what << ": " << bytes.now / per << " bytes, at most " << bytes.peak / per << "\n";
  };
  const BroadPhase::Config config{.algorithm = "sweep-and-prune", .threads = 1};
  for (const std::string how : {"map()", "update(boxes)", "add()", "add() with filters"}) {
    EXPECT_TRUE(holds_in_child([&] {
      constexpr std::uint32_t n = 300'000;
      BroadPhase broad_phase(config);
      std::vector<Aabb> given(n, unit);
      const Added boxes = bytes_of([&] {
        for (std::uint32_t k = 0; how.starts_with("add()") && k < n; ++k) {
          broad_phase.add(apart(k), {.mask = how == "add()" ? ~0U : 3U});
        }
        for (std::size_t frame = 0; frame < 4; ++frame) {
          if (how == "update(boxes)") {
            for (std::uint32_t k = 0; k < n; ++k) given[k] = apart(k + frame);
            (void)broad_phase.update(given);
            continue;
          }
          const std::span<Aabb> mapped = how == "map()" ? broad_phase.map(n) : std::span<Aabb>();
          for (std::uint32_t k = 0; k < n; ++k) {
            mapped.empty() ? broad_phase.move(k, apart(k + frame)) : void(mapped[k] = apart(k + frame));
          }
          (void)broad_phase.update();
        }
      });
      print((how + ", per box").c_str(), boxes, n);
      EXPECT_LT(boxes.peak, 220.0 * n);
      print("  shrunk", bytes_of([&] { broad_phase.shrink(); }), n);
    }));
  }
  EXPECT_TRUE(holds_in_child([&] {
    constexpr std::uint32_t n = 8000;
    constexpr std::uint32_t count = n * (n - 1) / 2;
    constexpr double pairs = count;
    BroadPhase broad_phase(config);
    for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(apart(k));
    (void)broad_phase.update();
    const auto update = [&](const auto& box_of) {
      for (std::uint32_t k = 0; k < n; ++k) broad_phase.move(k, box_of(k));
      (void)broad_phase.update();
    };
    const Added come = bytes_of([&] { update([](std::uint32_t /*k*/) { return unit; }); });
    const Added stay = bytes_of([&] { update([](std::uint32_t /*k*/) { return apart(1); }); });
    const Added go = bytes_of([&] { update(apart); });
    print("as pairs come, per pair", come, pairs);
    print("  as they stay", stay, pairs);
    print("  as they go", go, pairs);
    EXPECT_LT(come.peak, 26 * pairs);
    EXPECT_LT(come.now + stay.peak, 34 * pairs);
    EXPECT_LT(come.now + stay.now + go.peak, 42 * pairs);
    print("  shrunk", bytes_of([&] { broad_phase.shrink(); }), pairs);
  }));
  EXPECT_TRUE(holds_in_child([&] {
    constexpr std::uint32_t n = 8000;
    const std::vector<Aabb> boxes(n, unit);
    std::vector<Pair> pairs;
    const Added bytes = bytes_of([&] { pairs = overlapping_pairs(boxes, {}, config); });
    print("overlapping_pairs(), per pair", bytes, static_cast<double>(pairs.size()));
    EXPECT_LT(bytes.peak, 17 * static_cast<double>(pairs.size()));
  }));
}

NOT_IN(sanitizers, "takes long");
TEST(LongList, OfTooManyPairsIsCountedBeforeItIsStored) {
  for (const char* algorithm : {"sweep-and-prune", "oracle"}) {
    EXPECT_TRUE(holds_in_child([&] {
      limit_memory(std::size_t{4} << 30U);
      BroadPhase broad_phase({.algorithm = algorithm});
      broad_phase.add(unit);
      broad_phase.add(unit);
      EXPECT_EQ(broad_phase.update().added.size(), 1U);
      std::ranges::fill(broad_phase.map(70'000), unit);  // 2.4 billion pairs
      EXPECT_NE(error_of([&] { broad_phase.update(); }).find("more than 2147483648 pairs"),
                std::string::npos);
      EXPECT_EQ(broad_phase.pairs().size(), 1U);
      std::ranges::fill(broad_phase.map(3), unit);
      EXPECT_EQ(broad_phase.update().added.size(), 2U);
    })) << algorithm;
  }
}

NOT_IN(sanitizers, "takes long");
TEST(LongList, ThatIsCountedFirstIsComplete) {
  EXPECT_TRUE(holds_in_child([] {
    constexpr std::uint32_t n = 24'000;
    const Pairs pairs = overlapping_pairs(std::vector<Aabb>(n, unit), {}, {.algorithm = "sweep-and-prune"});
    ASSERT_EQ(pairs.size(), std::size_t{n} * (n - 1) / 2);
    std::size_t k = 0;
    for (std::uint32_t b = 0; b < n; ++b) {
      for (std::uint32_t a = 0; a < b; ++a) {
        if (pairs[k++] != Pair{a, b}) return ADD_FAILURE() << a << ", " << b, void();
      }
    }
  }));
}

}  // namespace
}  // namespace broadcl::test
