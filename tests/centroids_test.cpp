#include "finders/centroids.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/device.hpp>
#include <broadcl/filter.hpp>

#include "base/packed_box.hpp"
#include "boxes.hpp"
#include "environment.hpp"
#include "opencl/context.hpp"
#include "runs.hpp"
#include "scenes/random.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

SUITE_ALSO_IN(CentroidBoundsOf, gpu_profile | rusticl);

/// The same as ordered() in kernels/centroids.h.
std::uint32_t ordered(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  return bits >> 31 != 0 ? ~bits : bits | 0x80000000U;
}

using Words = std::array<std::uint32_t, 6>;

Words expected_of(const std::vector<Aabb>& boxes) {
  Words words{};
  for (const auto& [lower, upper] : boxes) {
    std::array<float, 3> centroid{};
    for (std::size_t k = 0; k < 3; ++k) centroid.at(k) = lower[k] * 0.5F + upper[k] * 0.5F;
    if (!std::ranges::all_of(centroid, [](float x) { return x > -1e30F && x < 1e30F; })) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      words.at(k) = std::max(words.at(k), ordered(-centroid.at(k)));
      words.at(3 + k) = std::max(words.at(3 + k), ordered(centroid.at(k)));
    }
  }
  return words;
}

void expect_bounds(const opencl::Context& context, opencl::SizedKernel& kernel, CentroidBounds& bounds,
                   std::vector<Aabb> boxes) {
  SCOPED_TRACE(boxes.size());
  const std::size_t n = boxes.size();
  const Words expected = expected_of(boxes);
  boxes.push_back({{-1e9F, -1e9F, -1e9F}, {1e9F, 1e9F, 1e9F}});  // not one of the n boxes
  const cl::Buffer buffer = context.buffer(boxes.size() * sizeof(Aabb));
  context.queue().enqueueWriteBuffer(buffer, CL_TRUE, 0, boxes.size() * sizeof(Aabb), boxes.data());
  bounds.enqueue(kernel, buffer, cl::Buffer(), n);
  Words words{};
  context.queue().enqueueReadBuffer(bounds.result(), CL_TRUE, 0, sizeof words, words.data());
  EXPECT_EQ(words, expected);
}

constexpr std::uint32_t few_worlds = 5;

/// Box k is in world k % few_worlds, which has a bucket of its own if there are at least as many buckets.
void expect_bounds_of_worlds(const opencl::Context& context, opencl::SizedKernel& kernel,
                             CentroidBounds& bounds, const std::vector<Aabb>& boxes) {
  SCOPED_TRACE(boxes.size());
  const std::size_t n = boxes.size();
  std::vector<Filter> filters(n);
  for (std::uint32_t k = 0; k < n; ++k) filters[k].world = k % few_worlds;
  const cl::Buffer box_buffer = context.buffer(n * sizeof(Aabb));
  const cl::Buffer filter_buffer = context.buffer(n * sizeof(Filter));
  context.queue().enqueueWriteBuffer(box_buffer, CL_TRUE, 0, n * sizeof(Aabb), boxes.data());
  context.queue().enqueueWriteBuffer(filter_buffer, CL_TRUE, 0, n * sizeof(Filter), filters.data());
  bounds.enqueue(kernel, box_buffer, filter_buffer, n);
  std::vector<Words> words(bounds.buckets());
  context.queue().enqueueReadBuffer(bounds.result(), CL_TRUE, 0, words.size() * sizeof(Words), words.data());
  std::vector<std::vector<Aabb>> of_buckets(words.size());
  for (std::uint32_t k = 0; k < n; ++k) of_buckets[filters[k].world % (words.size() - 1)].push_back(boxes[k]);
  for (std::size_t bucket = 0; bucket < words.size(); ++bucket) {
    EXPECT_EQ(words[bucket], expected_of(of_buckets[bucket])) << "bucket " << bucket;
  }
}

Aabb point(float x, float y, float z) {
  return {{x, y, z}, {x, y, z}};
}

std::vector<Aabb> random_boxes(std::size_t n) {
  scenes::Random random(n);
  std::vector<Aabb> boxes;
  for (std::size_t k = 0; k < n; ++k) {
    const auto p = random.vector(-100, 100);
    const auto edges = random.vector(0, 3);
    boxes.push_back({{p.x(), p.y(), p.z()}, {p.x() + edges.x(), p.y() + edges.y(), p.z() + edges.z()}});
  }
  return boxes;
}

class CentroidBoundsOf : public ::testing::TestWithParam<std::string> {
 protected:
  void expect(const std::vector<Aabb>& boxes) { expect_bounds(context_, kernel_, centroids_, boxes); }
  void expect_worlds(const std::vector<Aabb>& boxes) {
    expect_bounds_of_worlds(context_, kernel_, centroids_, boxes);
  }

 private:
  ScopedVariable shape_{"BROADCL_TUNING", GetParam()};
  opencl::Context context_{select_device(), false};
  opencl::SizedKernel kernel_{context_.sized_kernel(context_.program("centroids.cl"), "centroids")};
  CentroidBounds centroids_{context_};
};

ALSO_IN(oclgrind);
TEST_P(CentroidBoundsOf, SmallSetsOfEachSize) {
  for (const std::size_t n : {0U, 1U, 2U, 3U, 63U, 64U, 65U, 127U, 129U, 1U, 0U, 2U}) expect(random_boxes(n));
}

TEST_P(CentroidBoundsOf, SetsOfEachSize) {
  for (const std::size_t n : {1023U, 4095U, 4097U, 54'321U, 1'000'000U}) expect(random_boxes(n));
}

ALSO_IN(oclgrind);
TEST_P(CentroidBoundsOf, SmallSetsInEachOrder) {
  std::vector<Aabb> boxes(501, point(1, -2, 3));
  expect(boxes);
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const auto x = static_cast<float>(k) - 250;
    boxes[k] = point(x, x / 3, -x);
  }
  expect(boxes);
  std::ranges::reverse(boxes);
  expect(boxes);
}

ALSO_IN(oclgrind);
TEST_P(CentroidBoundsOf, SmallBoxesWithoutACentroidCountForNothing) {
  const Aabb plane{{-infinity, -infinity, -infinity}, {infinity, 0, infinity}};
  const Aabb half{{0, 0, 0}, {infinity, 1, 1}};
  const Aabb huge = point(1e30F, 0, 0);
  expect({packed_empty(), plane, half, huge});
  expect({packed_empty(), point(-0.0F, 0, -1), plane, half, point(0, -0.0F, 5), huge});
}

/// Objects of a few worlds, in reductions whose numbers of buckets grow and shrink.
ALSO_IN(oclgrind);
TEST_P(CentroidBoundsOf, SmallWorlds) {
  for (const std::size_t n : {10U, 10U, 300U, 300U, 10U, 600U, 600U}) expect_worlds(random_boxes(n));
}

INSTANTIATE_TEST_SUITE_P(Tuning, CentroidBoundsOf, ::testing::Values("cpu", "gpu"), named_by_parameter);

}  // namespace
}  // namespace broadcl::test
