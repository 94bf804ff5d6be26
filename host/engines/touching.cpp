#include "engines/touching.hpp"

#include <algorithm>

#include "base/distance.hpp"
#include "base/floating_point.hpp"
#include "base/packed_box.hpp"
#include "base/pair_lists.hpp"
#include "base/prefetch.hpp"
#include "opencl/common_program.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

constexpr std::size_t pairs_per_item = 8;    // of the kernel
constexpr std::size_t least_touching = 511;  // that are read at once, with their number
constexpr std::size_t ahead = 16;

[[gnu::noinline]] void append_in_doubt(std::span<const Pair> pairs, std::span<const Aabb> boxes,
                                       std::span<const float> reaches, std::vector<Pair>& to) {
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (k + ahead < pairs.size()) {
      prefetch(&boxes[pairs[k + ahead].a]);
      prefetch(&reaches[pairs[k + ahead].a]);
    }
    const auto [a, b] = pairs[k];
    if (is_in_doubt(boxes[a], boxes[b], reaches[a] + reaches[b])) to.push_back(pairs[k]);
  }
}

}  // namespace

std::vector<Pair> touching_pairs(std::span<const Pair> pairs, std::span<const Aabb> boxes,
                                 std::span<const float> reaches, AxisSet axes, const Threads& threads) {
  return select_pairs(pairs, threads, [&](std::span<const Pair> part, std::vector<Pair>& touching) {
    const DefaultFloatingPoint as_everywhere;
    if (!reaches.empty()) return append_in_doubt(part, boxes, reaches, touching);
    for (std::size_t k = 0; k < part.size(); ++k) {
      if (k + ahead < part.size()) prefetch(&boxes[part[k + ahead].a]);
      if (packed_touch(boxes[part[k].a], boxes[part[k].b], axes)) touching.push_back(part[k]);
    }
  });
}

TouchingPairs::TouchingPairs(const opencl::Context& context, opencl::Profiler& profiler)
    : context_(context),
      profiler_(profiler),
      kernel_(context.sized_kernel(opencl::common_program(context), "touching_pairs")) {}

std::vector<Pair> TouchingPairs::find(const Frame& frame, AxisSet axes) {
  const std::size_t count = frame.pairs.found();
  if (count == 0) return {};
  opencl::Profiler::Scope stage(profiler_, "touching");
  const cl::CommandQueue& queue = context_.queue();
  std::vector<Pair> pairs;
  for (std::size_t expected = expected_;; expected = expected_) {
    const std::size_t most = std::max(least_touching, expected + expected / 4);
    const std::size_t bytes = (1 + most) * sizeof(Pair);
    if (result_.bytes() < bytes) is_counted_ = false;
    result_.reserve(context_, bytes, "touching pairs");
    if (!is_counted_) context_.fill(result_.get(), counted_ = 0, 0, 1, stage.event());
    is_counted_ = false;  // if anything below fails
    opencl::set_arguments(kernel_.kernel, 0, static_cast<cl_uint>(frame.pairs.capacity),
                          static_cast<cl_uint>(frame.pairs.kept), static_cast<cl_uint>(frame.pairs.added),
                          static_cast<cl_uint>(axes), counted_, static_cast<cl_uint>(most),
                          frame.pairs.buffer.get(), frame.objects.boxes, result_.get());
    kernel_.enqueue(queue, opencl::divide_up(count, pairs_per_item), stage.event());
    pairs.resize(1 + most);
    queue.enqueueReadBuffer(result_.get(), CL_TRUE, 0, bytes, pairs.data());
    expected_ = pairs.front().a - counted_;
    counted_ = pairs.front().a;
    is_counted_ = true;
    if (expected_ <= most) break;
  }
  pairs.resize(1 + expected_);
  pairs.erase(pairs.begin());
  return pairs;
}

}  // namespace broadcl
