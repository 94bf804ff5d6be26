#include "benchmarks.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include "finders/centroids.hpp"
#include "opencl/context.hpp"
#include "opencl/radix_sort.hpp"
#include "opencl/scan.hpp"
#include "scenes/generators.hpp"

namespace broadcl {
namespace {

template <class Word>
std::vector<Word> random_words(std::size_t n) {
  std::mt19937_64 random(n);
  std::vector<Word> words(n);
  std::generate(words.begin(), words.end(), [&] { return static_cast<Word>(random()); });
  return words;
}

/// Times a function on a fresh copy of its input; making the copy is not timed.
void time_on_copies(benchmark::State& state, std::size_t n, const std::function<void()>& copy,
                    const std::function<void()>& function) {
  for ([[maybe_unused]] auto _ : state) {
    copy();
    const auto start = std::chrono::steady_clock::now();
    function();
    state.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  state.counters["elements"] =
      benchmark::Counter(static_cast<double>(n), benchmark::Counter::kIsIterationInvariantRate);
}

/// Times enqueued work until the queue has finished.
template <class Word>
void time_on_device(benchmark::State& state, const opencl::Context& context, const std::vector<Word>& input,
                    const std::function<void(const cl::Buffer&)>& enqueue) {
  const std::size_t bytes = input.size() * sizeof(Word);
  const cl::Buffer original(context.context(), CL_MEM_READ_WRITE, bytes);
  const cl::Buffer buffer(context.context(), CL_MEM_READ_WRITE, bytes);
  context.queue().enqueueWriteBuffer(original, CL_TRUE, 0, bytes, input.data());
  const auto copy = [&] {
    context.queue().enqueueCopyBuffer(original, buffer, 0, 0, bytes);
    context.queue().finish();
  };
  const auto run = [&] {
    enqueue(buffer);
    context.queue().finish();
  };
  copy();
  run();
  time_on_copies(state, input.size(), copy, run);
}

std::vector<Aabb> random_boxes(std::size_t n) {
  const scenes::MovingBoxes boxes(static_cast<std::uint32_t>(n), scenes::MovingBoxes::Sizes::uniform);
  return {boxes.boxes().begin(), boxes.boxes().end()};
}

void centroids_on_device(benchmark::State& state, std::size_t n) {
  const opencl::Context context(select_device(), false);
  opencl::SizedKernel kernel = context.sized_kernel(context.program("centroids.cl"), "centroids");
  CentroidBounds bounds(context);
  time_on_device(state, context, random_boxes(n),
                 [&](const cl::Buffer& boxes) { bounds.enqueue(kernel, boxes, cl::Buffer(), n); });
}

void centroids_on_host(benchmark::State& state, std::size_t n) {
  const std::vector<Aabb> boxes = random_boxes(n);
  time_on_copies(
      state, n, [] {},
      [&] {
        Eigen::AlignedBox3f bounds;
        for (const auto& [lower, upper] : boxes) {
          bounds.extend((Eigen::Vector3f::Map(lower.data()) + Eigen::Vector3f::Map(upper.data())) / 2);
        }
        benchmark::DoNotOptimize(bounds);
      });
}

void scan_on_device(benchmark::State& state, std::size_t n) {
  const opencl::Context context(select_device(), false);
  opencl::Scan scan(context);
  time_on_device(state, context, random_words<std::uint32_t>(n),
                 [&](const cl::Buffer& values) { scan.enqueue(values, values, n); });
}

void scan_on_host(benchmark::State& state, std::size_t n) {
  const auto input = random_words<std::uint32_t>(n);
  std::vector<std::uint32_t> values;
  time_on_copies(
      state, n, [&] { values = input; },
      [&] { std::exclusive_scan(values.begin(), values.end(), values.begin(), std::uint32_t{0}); });
}

void sort_on_device(benchmark::State& state, std::size_t n) {
  const opencl::Context context(select_device(), false);
  opencl::RadixSort sort(context);
  const cl::Buffer scratch(context.context(), CL_MEM_READ_WRITE, n * sizeof(std::uint64_t));
  constexpr opencl::RadixSort::Keys keys{{32, 32}};
  time_on_device(state, context, random_words<std::uint64_t>(n),
                 [&](const cl::Buffer& elements) { sort.enqueue(elements, scratch, n, keys); });
}

/// Radix sort by the upper half on one thread, least significant digit first; all digits are counted in one
/// pass. (Four digits of 8 bits; three of 11 take longer.)
void sort_by_upper_half(std::vector<std::uint64_t>& elements, std::vector<std::uint64_t>& scratch) {
  constexpr unsigned digit_bits = 8;
  constexpr unsigned passes = 4;
  constexpr std::size_t digits = std::size_t{1} << digit_bits;
  std::array<std::array<std::uint32_t, digits>, passes> places{};
  const auto digit_of = [](std::uint64_t element, unsigned pass) {
    return element >> (32 + pass * digit_bits) & (digits - 1);
  };
  for (const std::uint64_t element : elements) {
    for (unsigned pass = 0; pass < passes; ++pass) ++places[pass][digit_of(element, pass)];
  }
  for (unsigned pass = 0; pass < passes; ++pass) {
    auto& next = places[pass];
    std::exclusive_scan(next.begin(), next.end(), next.begin(), std::uint32_t{0});
    for (const std::uint64_t element : elements) scratch[next[digit_of(element, pass)]++] = element;
    std::swap(elements, scratch);
  }
}

void sort_on_host(benchmark::State& state, std::size_t n) {
  const auto input = random_words<std::uint64_t>(n);
  std::vector<std::uint64_t> elements;
  std::vector<std::uint64_t> scratch(n);
  time_on_copies(
      state, n, [&] { elements = input; }, [&] { sort_by_upper_half(elements, scratch); });
}

}  // namespace

/// Benchmarks of the primitives, each next to a host thread that does the same:
///
///   centroids/NAME/N    bounds of the centroids of N boxes
///   scan/NAME/N         exclusive prefix sum of N uints
///   radix-sort/NAME/N   N random pairs {value, key} of uints, sorted by key
///
/// NAME is `device`, timed from the call until the queue has finished, or `host`.
void register_primitives() {
  const auto add = [](const std::string& name, std::size_t n, auto* function) {
    benchmark::RegisterBenchmark((name + "/" + std::to_string(n)).c_str(), function, n)
        ->UseManualTime()
        ->Unit(benchmark::kMicrosecond);
  };
  for (const std::size_t n : {3500U, 65536U, 1'000'000U}) {
    add("centroids/device", n, centroids_on_device);
    add("centroids/host", n, centroids_on_host);
    add("scan/device", n, scan_on_device);
    add("scan/host", n, scan_on_host);
    add("radix-sort/device", n, sort_on_device);
    add("radix-sort/host", n, sort_on_host);
  }
}

}  // namespace broadcl
