#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/device.hpp>
#include <broadcl/pair.hpp>

#include "each_algorithm.hpp"
#include "engines/kernel_arguments.hpp"
#include "opencl/context.hpp"
#include "opencl/launch.hpp"
#include "runs.hpp"
#include "scenes/random.hpp"

namespace broadcl::test {
namespace {

SUITE_ALSO_IN(OrderSmall, gpu_profile | rusticl);

bool before(const Pair& s, const Pair& t) {
  return std::pair(s.b, s.a) < std::pair(t.b, t.a);
}

/// kernels/order_small.cl, compiled with one work-item or many per work-group, and with more or less
/// memory for what a work-group sorts at once.
class OrderSmall : public ::testing::TestWithParam<std::pair<std::size_t, std::string>> {
 protected:
  struct Sorted {
    std::vector<std::uint32_t> next_counts;
    Pairs added, removed;
  };

  [[nodiscard]] cl::Buffer copy_of(const void* data, std::size_t bytes) const {
    cl::Buffer buffer = context_.buffer(bytes);
    context_.queue().enqueueWriteBuffer(buffer, CL_TRUE, 0, bytes, data);
    return buffer;
  }

  /// @param capacity Of each list.
  [[nodiscard]] Sorted sort(const Pairs& added_pairs, const Pairs& removed_pairs, std::size_t capacity,
                            std::size_t groups) {
    Pairs list(100, {7, 8});  // what precedes the added pairs is not read
    list.insert(list.end(), added_pairs.begin(), added_pairs.end());
    std::vector<std::uint32_t> words(layout::COUNTS);
    words[layout::COUNT_ADDED] = static_cast<std::uint32_t>(added_pairs.size());
    words[layout::COUNT_REMOVED] = static_cast<std::uint32_t>(removed_pairs.size());
    const Pairs removed_list = removed_pairs.empty() ? Pairs(1) : removed_pairs;
    const cl::Buffer pairs = copy_of(list.data(), list.size() * sizeof(Pair));
    const cl::Buffer removals = copy_of(removed_list.data(), removed_list.size() * sizeof(Pair));
    const cl::Buffer now = copy_of(words.data(), layout::COUNTS * sizeof(std::uint32_t));
    const cl::Buffer next = copy_of(words.data(), layout::COUNTS * sizeof(std::uint32_t));
    const Pairs untouched(capacity + 1, {1, 2});
    const cl::Buffer to_added = copy_of(untouched.data(), untouched.size() * sizeof(Pair));
    const cl::Buffer to_removed = copy_of(untouched.data(), untouched.size() * sizeof(Pair));
    const auto n = static_cast<cl_uint>(capacity);
    const layout::order_scalars_t scalars{.capacity = static_cast<cl_uint>(list.size()),
                                          .list_capacity = n,
                                          .total_capacity = 2 * n,
                                          .tag = 5,
                                          .buckets_of_list = 0,
                                          .bucket_bits = 0,
                                          .worlds = 0,
                                          .second_set = 0};
    opencl::set_arguments(kernel_, 0, scalars, pairs, removals, now, next, cl::Buffer(), cl::Buffer(),
                          to_added, to_removed);
    context_.queue().enqueueNDRangeKernel(kernel_, cl::NullRange, cl::NDRange(groups * group_, 2),
                                          cl::NDRange(group_, 1));
    Sorted sorted{std::vector<std::uint32_t>(layout::COUNTS), untouched, untouched};
    const auto read = [&](const cl::Buffer& from, void* to, std::size_t bytes) {
      context_.queue().enqueueReadBuffer(from, CL_TRUE, 0, bytes, to);
    };
    read(next, sorted.next_counts.data(), layout::COUNTS * sizeof(std::uint32_t));
    read(to_added, sorted.added.data(), untouched.size() * sizeof(Pair));
    read(to_removed, sorted.removed.data(), untouched.size() * sizeof(Pair));
    return sorted;
  }

  void expect_sorted(const Pairs& added_pairs, const Pairs& removed_pairs, std::size_t groups) {
    SCOPED_TRACE(std::to_string(added_pairs.size()) + " added, " + std::to_string(removed_pairs.size()) +
                 " removed, " + std::to_string(groups) + " work-groups");
    const std::size_t capacity = std::max({added_pairs.size(), removed_pairs.size(), std::size_t{1}});
    const Sorted sorted = sort(added_pairs, removed_pairs, capacity, groups);
    EXPECT_EQ(sorted.next_counts.at(layout::COUNT_HALTED), 0U);
    for (const auto& [list, result] :
         {std::pair(added_pairs, sorted.added), std::pair(removed_pairs, sorted.removed)}) {
      Pairs expected = list;
      std::ranges::sort(expected, before);
      expected.resize(capacity + 1, {1, 2});  // nothing is written beyond
      EXPECT_EQ(result, expected);
    }
  }

  const opencl::Context context_{select_device(), false};
  const std::size_t group_ = GetParam().first;
  cl::Kernel kernel_{
      context_.kernel(context_.program("common.cl", "-DGROUP=" + std::to_string(group_) + GetParam().second),
                      "order_small", group_)};
};

/// Distinct pairs of `slots` slots, in random order.
Pairs random_pairs(std::size_t n, std::uint32_t slots, std::uint64_t seed) {
  scenes::Random random(seed);
  Pairs pairs;
  while (pairs.size() < n) {
    while (pairs.size() < n + n / 2) {
      const auto s = random.index(slots);
      const auto t = random.index(slots);
      if (s != t) pairs.push_back({std::min(s, t), std::max(s, t)});
    }
    std::ranges::sort(pairs, before);
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  }
  random.shuffle(std::span(pairs));
  pairs.resize(n);
  return pairs;
}

/// Pairs with the same b, which is as large as a slot may be, in random order.
Pairs pairs_of_one(std::size_t n, std::uint64_t seed) {
  Pairs pairs(n);
  for (std::size_t k = 0; k < n; ++k) pairs[k] = {static_cast<std::uint32_t>(k * 3), 0x7ffffffe};
  scenes::Random(seed).shuffle(std::span(pairs));
  return pairs;
}

TEST_P(OrderSmall, SortsEveryNumberOfChanges) {
  for (const std::size_t n :
       std::vector<std::size_t>{0, 1, 2, 3, 63, 64, 65, 255, 256, 257, 1000, 2047, 2048, 2049, 4500}) {
    const auto slots = static_cast<std::uint32_t>(2 * n + 10);
    expect_sorted(random_pairs(n, slots, 1), random_pairs(n / 3, slots, 2), n / 64 + 1);
    expect_sorted(random_pairs(n / 5, slots, 3), random_pairs(n, slots, 4), n / 64 + 9);
    expect_sorted(pairs_of_one(n, 5), random_pairs(n, slots, 6), n / 64 + 1);
  }
}

TEST_P(OrderSmall, SortsChangesInAnyOrder) {
  Pairs ascending = random_pairs(3000, 2000, 7);
  std::ranges::sort(ascending, before);
  const Pairs descending(ascending.rbegin(), ascending.rend());
  expect_sorted(ascending, descending, 47);
}

NOT_IN(rusticl, "runs on llvmpipe, which ends a work-item after 65,535 iterations of its loops");
TEST_P(OrderSmall, SortsListsOfWhichTheSampleSaysLittle) {
  constexpr std::size_t groups = 47;
  constexpr std::size_t samples = 2 * groups;
  constexpr std::size_t n = 32 * samples;
  Pairs ascending = random_pairs(n, 2000, 7);
  std::ranges::sort(ascending, before);
  Pairs halves = ascending;  // the sample, every 32nd change, is of the smaller half
  for (std::size_t k = 0; k < n / 2; ++k) {
    halves[2 * k] = ascending[k];
    halves[2 * k + 1] = ascending[n / 2 + k];
  }
  expect_sorted(halves, ascending, groups);
}

/// One change more than a work-group sorts at once.
NOT_IN(rusticl, "runs on llvmpipe, which ends a work-item after 65,535 iterations of its loops");
TEST_P(OrderSmall, SortsOneMoreThanFitsInAPart) {
  expect_sorted(random_pairs(513, 2000, 12), pairs_of_one(257, 13), 1);
}

/// (With fewer iterations than those after which llvmpipe ends a work-item.)
ALSO_IN(oclgrind_gpu_profile);
TEST_P(OrderSmall, SortsInPartsWhatIsTooMuch) {
  expect_sorted(random_pairs(300, 2000, 8), pairs_of_one(290, 9), 1);
  expect_sorted(random_pairs(400, 2000, 8), pairs_of_one(400, 9), 2);
}

TEST_P(OrderSmall, WritesNothingIfAListDoesNotFit) {
  const Pairs many = random_pairs(300, 2000, 10);
  const Pairs short_list = random_pairs(200, 2000, 11);
  for (const bool is_added : {false, true}) {
    const Sorted sorted = is_added ? sort(many, short_list, 299, 5) : sort(short_list, many, 299, 5);
    EXPECT_EQ(sorted.next_counts.at(layout::COUNT_HALTED), 1U);
    EXPECT_EQ(sorted.added, Pairs(300, Pair{1, 2}));
    EXPECT_EQ(sorted.removed, Pairs(300, Pair{1, 2}));
  }
}

INSTANTIATE_TEST_SUITE_P(Compiled, OrderSmall,
                         ::testing::Values(std::pair(1, ""), std::pair(256, ""),
                                           std::pair(1, " -DLARGEST_RANGE=256U"),
                                           std::pair(256, " -DLARGEST_RANGE=256U")),
                         [](const auto& instance) {
                           return "Group" + std::to_string(instance.param.first) +
                                  (instance.param.second.empty() ? "" : "LittleMemory");
                         });

}  // namespace
}  // namespace broadcl::test
