#include "whole_list.hpp"

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/device.hpp>

#include "algorithms/algorithm.hpp"
#include "algorithms/pair_delta.hpp"
#include "algorithms/pair_finder.hpp"
#include "algorithms/scoped_timer.hpp"
#include "cli/npy.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {
namespace {

/// Objects that are all new in every frame, so that each search finds all pairs.
Search renewed(const opencl::Context& context, const std::vector<Aabb>& boxes) {
  const std::size_t n = boxes.size();
  const cl::CommandQueue& queue = context.queue();
  const cl::Buffer buffer = context.buffer((n + Search::padding) * sizeof(Aabb));
  queue.enqueueWriteBuffer(buffer, CL_TRUE, 0, n * sizeof(Aabb), boxes.data());
  constexpr cl_uint stamp = 1;
  const cl::Buffer stamps = context.buffer(n * sizeof(cl_uint));
  queue.enqueueFillBuffer(stamps, cl_uint{stamp << 1 | 1}, 0, n * sizeof(cl_uint));
  return {.slots = static_cast<cl_uint>(n),
          .boxes = buffer,
          .filters = stamps,
          .changed = stamps,
          .stamps = {.words = stamps, .stamp = stamp, .any_renewed = true},
          .last_slots = static_cast<cl_uint>(n),
          .last_boxes = buffer,
          .last_filters = stamps};
}

void time_whole_list(benchmark::State& state, const std::filesystem::path& file) {
  const opencl::Context context(select_device(), false);
  opencl::Profiler profiler(false);
  PairDelta delta(context, profiler);
  const auto tiles = make_tiles(context, 0);
  const Search search = renewed(context, cli::read_boxes(file));
  double seconds = 0;
  const auto find = [&] {
    context.queue().finish();
    seconds = 0;
    const ScopedTimer timer(seconds);
    tiles->find(search, delta, profiler);
    context.queue().finish();
  };
  const auto pairs = [&] {
    delta.begin({.search = search, .find = find});
    return delta.finish().added.size();
  };
  const std::size_t overlapping = pairs();  // the lists grow here, untimed
  for ([[maybe_unused]] auto _ : state) {
    if (pairs() != overlapping) state.SkipWithError("the number of pairs changed");
    state.SetIterationTime(seconds);
  }
  state.counters["overlapping"] = static_cast<double>(overlapping);
}

}  // namespace

void register_whole_list() {
  const char* folder = std::getenv("BROADCL_TEST_DATA");  // NOLINT(concurrency-mt-unsafe)
  if (folder == nullptr) return;
  for (const std::string set :
       {"cloth-funnel-faces", "cloth-funnel-edges", "cloth-ball-faces", "cloth-ball-edges"}) {
    benchmark::RegisterBenchmark(("whole-list/" + set).c_str(), time_whole_list,
                                 std::filesystem::path(folder) / (set + ".npy"))
        ->UseManualTime()
        ->Iterations(20)
        ->Unit(benchmark::kMicrosecond);
  }
}

}  // namespace broadcl
