#include "benchmarks.hpp"

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include <broadcl/box_view.hpp>
#include <broadcl/device.hpp>

#include "base/packed_boxes.hpp"
#include "cli/box_file.hpp"
#include "engines/algorithm.hpp"
#include "engines/engine.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {
namespace {

Generation on_device(const opencl::Context& context, const std::vector<Aabb>& boxes) {
  const std::size_t n = boxes.size();
  Generation objects{.slots = static_cast<cl_uint>(n),
                     .boxes = context.buffer((n + Generation::padding) * sizeof(Aabb))};
  context.queue().enqueueWriteBuffer(objects.boxes, CL_TRUE, 0, n * sizeof(Aabb), boxes.data());
  return objects;
}

/// Tiles that sort in every frame, with the time of their last search.
class TimedTiles final : public PairFinder {
 public:
  explicit TimedTiles(const opencl::Context& context) : context_(context), tiles_(make_tiles(context)) {}

  void begin(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    tiles_->forget();
    tiles_->begin(search, sink, profiler);
  }
  void build(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    seconds = time([&] { tiles_->build(search, sink, profiler); });
  }
  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    seconds += time([&] { tiles_->find(search, sink, profiler); });
  }

  static inline double seconds = 0;

 private:
  template <class Function>
  [[nodiscard]] double time(const Function& function) const {
    context_.queue().finish();
    const auto start = std::chrono::steady_clock::now();
    function();
    context_.queue().finish();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }

  const opencl::Context& context_;
  std::unique_ptr<PairFinder> tiles_;
};

std::unique_ptr<PairFinder> make_timed_tiles(const opencl::Context& context) {
  return std::make_unique<TimedTiles>(context);
}

void time_whole_list(benchmark::State& state, const std::filesystem::path& file) {
  const opencl::Context context(select_device(), false);
  opencl::Profiler profiler(false);
  Engine engine(context, profiler, make_timed_tiles, Order::Target::host);
  const Generation objects = on_device(context, cli::read_boxes(file).as_float32());
  const Generation none{.boxes = objects.boxes};
  const auto search = [&](const Generation& now, const Generation& last) {
    engine.prepare();
    engine.begin({.now = now, .last = last});
    engine.search();
    return engine.finish().added;
  };
  struct Result {
    std::size_t pairs;
    double seconds;
  };
  const auto find_all = [&]() -> Result {
    const std::size_t found = search(objects, none);
    const double seconds = TimedTiles::seconds;
    search(none, objects);
    return {found, seconds};
  };
  const std::size_t overlapping = find_all().pairs;  // the lists grow here, untimed
  if (overlapping == 0) return state.SkipWithError("no pairs were found");
  for ([[maybe_unused]] auto _ : state) {
    const Result result = find_all();
    if (result.pairs != overlapping) state.SkipWithError("the number of pairs changed");
    state.SetIterationTime(result.seconds);
  }
  state.counters["overlapping"] = static_cast<double>(overlapping);
}

void time_whole_call(benchmark::State& state, const std::string& algorithm,
                     const std::filesystem::path& file) {
  const std::vector<Aabb> boxes = cli::read_boxes(file).as_float32();
  const auto find_all = [&] {
    const auto finder = make_algorithm({.algorithm = algorithm});
    finder->reserve(boxes.size(), false);
    const auto start = std::chrono::steady_clock::now();
    pack_boxes(boxes, "", 0, finder->boxes());
    const std::vector<Pair> pairs =
        finder->find_all({.boxes = finder->boxes().first(boxes.size()), .changed = {.all = true}});
    state.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    return pairs.size();
  };
  const std::size_t pairs = find_all();  // kernels are built here, untimed
  for ([[maybe_unused]] auto _ : state) {
    if (find_all() != pairs) state.SkipWithError("the number of pairs changed");
  }
  state.counters["overlapping"] = static_cast<double>(pairs);
}

}  // namespace

/// Benchmarks of finding all pairs at once, as for a new scene, in sets of real-world boxes:
///
///   whole-list/SET
///   whole-call/ALGORITHM/SET
///
/// `whole-list` is the time from boxes on the device to the unordered list of all pairs there, with `tiles`:
/// sorting, building the tree and searching, until the queue has finished. `whole-call` is that of
/// overlapping_pairs() without opening the device: from boxes on the host to the sorted list there. SET is
/// the name, without ".npy", of a file in the folder that BROADCL_TEST_DATA names; if the variable is not
/// set, these benchmarks do not exist.
void register_whole_list() {
  const char* folder = std::getenv("BROADCL_TEST_DATA");  // NOLINT(concurrency-mt-unsafe)
  if (folder == nullptr) return;
  for (const std::string set :
       {"cloth-funnel-faces", "cloth-funnel-edges", "cloth-ball-faces", "cloth-ball-edges"}) {
    const std::filesystem::path file = std::filesystem::path(folder) / (set + ".npy");
    benchmark::RegisterBenchmark(("whole-list/" + set).c_str(), time_whole_list, file)
        ->UseManualTime()
        ->Iterations(20)
        ->Unit(benchmark::kMicrosecond);
    for (const char* algorithm : {"tiles", "sweep-and-prune"}) {
      const std::string name = std::string("whole-call/") + algorithm + "/" + set;
      benchmark::RegisterBenchmark(name.c_str(), time_whole_call, std::string(algorithm), file)
          ->UseManualTime()
          ->Iterations(20)
          ->Unit(benchmark::kMillisecond);
    }
  }
}

}  // namespace broadcl
