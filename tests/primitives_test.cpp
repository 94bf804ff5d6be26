#include <algorithm>
#include <cstdint>
#include <functional>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/device.hpp>

#include "environment.hpp"
#include "expect_error.hpp"
#include "opencl/context.hpp"
#include "opencl/radix_sort.hpp"
#include "opencl/scan.hpp"
#include "runs.hpp"

namespace broadcl::opencl {
namespace {

SUITE_ALSO_IN(Scan, gpu_profile | rusticl);
SUITE_ALSO_IN(RadixSort, gpu_profile | rusticl);

using Element = std::uint64_t;  // RadixSort::Bits numbers its bits
using ::testing::HasSubstr;
using Keys = RadixSort::Keys;

/// Runs a test with the kernels of each tuning, but not with few work-items on llvmpipe, which ends
/// them too early (host/opencl/context.cpp).
void with_both_profiles(const std::function<void(const Context&)>& test) {
  for (const std::string profile : {"cpu", "gpu"}) {
    if (profile == "cpu" && select_device().name.find("llvmpipe") != std::string::npos) continue;
    SCOPED_TRACE(profile);
    const test::ScopedVariable variable("BROADCL_TUNING", profile);
    test(Context(select_device(), false));
  }
}

template <class T>
cl::Buffer to_device(const Context& context, const std::vector<T>& values) {
  cl::Buffer buffer(context.context(), CL_MEM_READ_WRITE, values.size() * sizeof(T));
  context.queue().enqueueWriteBuffer(buffer, CL_TRUE, 0, values.size() * sizeof(T), values.data());
  return buffer;
}

template <class T>
std::vector<T> from_device(const Context& context, const cl::Buffer& buffer, std::size_t n) {
  std::vector<T> values(n);
  context.queue().enqueueReadBuffer(buffer, CL_TRUE, 0, n * sizeof(T), values.data());
  return values;
}

/// Values after those under test, which must stay unchanged.
constexpr std::size_t behind = 3;

void expect_scanned(const Context& context, Scan& scan, std::vector<std::uint32_t> values) {
  const std::size_t n = values.size();
  SCOPED_TRACE(n);
  values.insert(values.end(), behind, 77);
  const cl::Buffer buffer = to_device(context, values);
  const cl::Buffer other = to_device(context, std::vector<std::uint32_t>(values.size(), 77));
  const auto expect_values = [&](const cl::Buffer& in) {
    // Not EXPECT_EQ, which would print all of them.
    const auto result = from_device<std::uint32_t>(context, in, values.size());
    const auto wrong = std::mismatch(values.begin(), values.end(), result.begin());
    EXPECT_EQ(wrong.first, values.end())
        << "value " << wrong.first - values.begin() << " is " << *wrong.second;
  };
  scan.enqueue(buffer, other, n);
  expect_values(buffer);
  scan.enqueue(buffer, buffer, n);
  std::exclusive_scan(values.begin(), values.end() - behind, values.begin(), std::uint32_t{0});
  expect_values(other);
  expect_values(buffer);
}

std::vector<std::uint32_t> random_uints(std::size_t n) {
  std::mt19937 random(static_cast<std::uint32_t>(n));
  std::vector<std::uint32_t> values(n);
  std::generate(values.begin(), values.end(), random);
  return values;
}

/// The number by which the keys compare an element.
Element key_of(Element element, const Keys& keys) {
  Element result = 0;
  unsigned shift = 0;
  for (const auto& [first, count] : {keys.minor, keys.major}) {
    if (count == 0) continue;
    result |= (element >> first & ~Element{0} >> (64 - count)) << shift;
    shift += count;
  }
  return result;
}

void expect_sorted(const Context& context, RadixSort& sort, std::vector<Element> elements, const Keys& keys) {
  const std::size_t n = elements.size();
  SCOPED_TRACE(n);
  elements.insert(elements.end(), behind, 77);
  const cl::Buffer buffer = to_device(context, elements);
  const cl::Buffer scratch(context.context(), CL_MEM_READ_WRITE, elements.size() * sizeof(Element));
  sort.enqueue(buffer, scratch, n, keys);
  std::stable_sort(elements.begin(), elements.end() - behind,
                   [&](Element a, Element b) { return key_of(a, keys) < key_of(b, keys); });
  const auto result = from_device<Element>(context, buffer, elements.size());
  const auto wrong = std::mismatch(elements.begin(), elements.end(), result.begin());
  EXPECT_EQ(wrong.first, elements.end())
      << "element " << wrong.first - elements.begin() << " is " << *wrong.second;
}

/// Runs a test with the kernels of each tuning, with that for GPUs both as it is and without the
/// launches for few elements.
void with_each_sort(const std::function<void(const Context&, RadixSort&)>& test) {
  with_both_profiles([&](const Context& context) {
    RadixSort sort(context);
    test(context, sort);
    if (context.launch().max_merged == 0) return;
    SCOPED_TRACE("by digits");
    RadixSort by_digits(context, 0);
    test(context, by_digits);
  });
}

/// {value, key}: the value is the position, which shows whether the sort is stable.
std::vector<Element> numbered(std::size_t n, const std::function<std::uint32_t(std::size_t)>& key) {
  std::vector<Element> elements(n);
  for (std::size_t k = 0; k < n; ++k) elements[k] = Element{key(k)} << 32 | k;
  return elements;
}

std::vector<Element> random_elements(std::size_t n) {
  std::mt19937_64 random(n);
  std::vector<Element> elements(n);
  std::generate(elements.begin(), elements.end(), random);
  return elements;
}

const Keys by_key{{32, 32}};

/// Also more words than there are work-items: Context::fill().
ALSO_IN(gpu_profile | rusticl);
TEST(Fill, SetsEachWordAndNoOther) {
  with_both_profiles([](const Context& context) {
    constexpr std::size_t first = 5;
    for (const std::size_t n : {1U, 63U, 65U, 262'144U, 262'145U, 600'001U}) {
      std::vector<std::uint32_t> words(first + n + behind, 77);
      const cl::Buffer buffer = to_device(context, words);
      context.fill(buffer, 8, first, n);
      std::fill_n(words.begin() + first, n, 8);
      EXPECT_TRUE(from_device<std::uint32_t>(context, buffer, words.size()) == words) << n;
    }
  });
}

ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST(Scan, SmallListsOfEachSize) {
  with_both_profiles([](const Context& context) {
    Scan scan(context);
    for (const std::size_t n : {0U, 1U, 2U, 3U, 4U, 5U, 31U, 32U, 33U, 255U, 256U, 257U, 333U}) {
      expect_scanned(context, scan, random_uints(n));
    }
  });
}

/// The fewest values that need several blocks, with each tuning.
ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST(Scan, SmallestListsOfSeveralBlocks) {
  with_both_profiles([](const Context& context) {
    Scan scan(context);
    expect_scanned(context, scan, random_uints(context.tuning() == Tuning::cpu ? 16385 : 4097));
  });
}

TEST(Scan, ListsOfEachSize) {
  with_both_profiles([](const Context& context) {
    Scan scan(context);
    for (const std::size_t n :
         {1023U, 1024U, 1025U, 4095U, 4096U, 4097U, 16383U, 16384U, 16385U, 54321U, 100'000U}) {
      expect_scanned(context, scan, random_uints(n));
    }
  });
}

/// More than one work-item can process on some devices: see split_into_blocks.
NOT_IN(sanitizers, "takes long");
TEST(Scan, NineMillion) {
  with_both_profiles([](const Context& context) {
    Scan scan(context);
    expect_scanned(context, scan, std::vector<std::uint32_t>(9'000'000, 3));
  });
}

ALSO_IN(oclgrind);
TEST(RadixSort, SmallListsOfEachSize) {
  with_each_sort([](const Context& context, RadixSort& sort) {
    for (const std::size_t n : {0U, 1U, 2U, 31U, 32U, 33U, 255U, 256U, 257U, 511U}) {
      expect_sorted(context, sort, random_elements(n), {{28, 9}});
    }
  });
}

/// The fewest elements that need several blocks.
ALSO_IN(oclgrind | oclgrind_gpu_profile);
TEST(RadixSort, SmallestListsOfSeveralBlocks) {
  with_each_sort([](const Context& context, RadixSort& sort) {
    expect_sorted(context, sort, random_elements(4097), {{61, 3}, {30, 6}});
  });
}

TEST(RadixSort, ListsOfEachSize) {
  with_each_sort([](const Context& context, RadixSort& sort) {
    for (const std::size_t n :
         {3583U, 3584U, 3585U, 4095U, 4096U, 4097U, 8191U, 12'345U, 54'321U, 100'000U}) {
      expect_sorted(context, sort, random_elements(n), by_key);
    }
  });
}

TEST(RadixSort, ElementsInEachOrderStayStable) {
  with_each_sort([](const Context& context, RadixSort& sort) {
    for (const std::uint32_t n : {3001U, 40'003U}) {
      const auto by = [&](const char* order, const std::function<std::uint32_t(std::size_t)>& key) {
        SCOPED_TRACE(order);
        expect_sorted(context, sort, numbered(n, key), by_key);
      };
      std::mt19937 random(n);
      by("all equal", [](std::size_t) { return 0x12345678U; });
      by("all zero", [](std::size_t) { return 0U; });
      by("all the largest", [](std::size_t) { return ~0U; });
      by("sorted", [](std::size_t k) { return static_cast<std::uint32_t>(k); });
      by("reversed", [&](std::size_t k) { return n - static_cast<std::uint32_t>(k); });
      by("alternating", [](std::size_t k) { return k % 2 == 0 ? ~0U : 0U; });
      by("few distinct", [&](std::size_t) { return (random() & 3U) * 0x40100401U; });
    }
  });
}

NOT_IN(sanitizers, "takes long, in kernels only");
TEST(RadixSort, RangesOfAnyBits) {
  with_each_sort([](const Context& context, RadixSort& sort) {
    for (const std::size_t n : {2000U, 9999U, 33'333U, 100'000U}) {
      for (const Keys& keys :
           {Keys{}, Keys{{5, 0}}, Keys{{0, 1}}, Keys{{63, 1}}, Keys{{7, 5}}, Keys{{25, 13}}, Keys{{0, 17}},
            Keys{{0, 64}}, Keys{{0, 13}, {32, 13}}, Keys{{32, 13}, {0, 13}}, Keys{{40, 3}, {20, 0}},
            Keys{{20, 0}, {2, 9}}, Keys{{3, 1}, {60, 4}}, Keys{{40, 24}, {0, 40}}, Keys{{0, 20}, {62, 2}}}) {
        SCOPED_TRACE(std::to_string(keys.minor.first) + ", " + std::to_string(keys.major.first));
        for (const auto& [first, count] : {keys.minor, keys.major}) {
          EXPECT_LE(first + count, 64U) << "an invalid range";
        }
        expect_sorted(context, sort, random_elements(n), keys);
      }
    }
  });
}

/// Sorts with one object that follow each other without a wait.
TEST(RadixSort, SortsInARowDoNotDisturbEachOther) {
  with_each_sort([](const Context& context, RadixSort& sort) {
    const cl::Buffer scratch(context.context(), CL_MEM_READ_WRITE, 40'000 * sizeof(Element));
    std::vector<std::vector<Element>> lists;
    std::vector<cl::Buffer> buffers;
    for (const std::size_t n : {40'000U, 300U, 8192U, 4097U}) {
      lists.push_back(random_elements(n));
      buffers.push_back(to_device(context, lists.back()));
    }
    const Keys all{{0, 64}};
    for (std::size_t k = 0; k < lists.size(); ++k) sort.enqueue(buffers[k], scratch, lists[k].size(), all);
    for (std::size_t k = 0; k < lists.size(); ++k) {
      std::sort(lists[k].begin(), lists[k].end());
      EXPECT_TRUE(from_device<Element>(context, buffers[k], lists[k].size()) == lists[k]) << k;
    }
  });
}

/// More than one work-item can process on some devices: see split_into_blocks.
NOT_IN(sanitizers, "takes long");
TEST(RadixSort, ThreeMillion) {
  with_each_sort([](const Context& context, RadixSort& sort) {
    expect_sorted(context, sort,
                  numbered(3'000'000, [](std::size_t k) { return ~static_cast<std::uint32_t>(k); }),
                  {{32, 6}});
  });
}

/// The longest lists that are sorted in few launches, and one element more, by all bits.
TEST(RadixSort, AroundTheLongestListsOfFewLaunchesByAllBits) {
  with_both_profiles([](const Context& context) {
    RadixSort sort(context);
    const std::size_t longest = context.launch().max_merged;
    for (const std::size_t n : {longest, longest + 1}) {
      expect_sorted(context, sort, random_elements(n), {{0, 64}});
    }
  });
}

/// Whether the device has this many bytes for one buffer, and for two.
bool has_memory(std::size_t bytes) {
  const Device device = select_device();
  return device.max_allocation >= bytes && device.memory >= 2 * bytes;
}

/// Nothing must be enqueued.
TEST(Scan, TooManyValuesAreRefused) {
  constexpr std::size_t too_many = std::size_t{1} << 31;
  with_both_profiles([](const Context& context) {
    const cl::Buffer small = context.buffer(8);
    EXPECT_THAT(test::error_of([&] { Scan(context).enqueue(small, small, too_many); }),
                HasSubstr("too many"));
    EXPECT_THAT(test::error_of([&] {
                  RadixSort(context).enqueue(small, small, too_many, Keys{{0, 64}});
                }),
                HasSubstr("too many"));
  });
}

TEST(Long, RadixSortOfTenMillion) {
  constexpr std::size_t n = 10'000'001;
  if (!has_memory(n * sizeof(Element)))
    GTEST_SKIP() << "the device has too little memory for 10 million elements twice";
  with_both_profiles([](const Context& context) {
    RadixSort sort(context);
    std::mt19937 random(2);
    expect_sorted(context, sort, numbered(n, [&](std::size_t) { return random(); }), by_key);
  });
}

}  // namespace
}  // namespace broadcl::opencl
