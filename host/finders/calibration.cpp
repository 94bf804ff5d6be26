#include "finders/calibration.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include <broadcl/aabb.hpp>

#include "engines/engine.hpp"
#include "opencl/kernel_source.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {
namespace {

/// A few boxes show the fixed cost of a frame, many boxes show the rest. Fewer are used if their search takes
/// `long_enough`. (On a GPU, a hundred boxes say little about a thousand: `brute-force` has them in one
/// work-group, `tiles` in a tree of one level.)
struct Sizes {
  std::size_t few, many;
};
constexpr Sizes sizes_of_cpu{.few = 128, .many = 4096};
constexpr Sizes sizes_of_gpu{.few = 1024, .many = 32768};

Sizes sizes_for(const opencl::Context& context) {
  return context.tuning() == opencl::Tuning::cpu ? sizes_of_cpu : sizes_of_gpu;
}

/// The shortest search counts, of at least fewest_searches, and of more until they have taken `long_enough`
/// in all.
constexpr int fewest_searches = 5;
constexpr int most_searches = 100;
constexpr double long_enough = 5e-3;  // seconds

/// Cubes in the unit cube, each of which overlaps about four others.
std::vector<Aabb> random_boxes(std::size_t n) {
  std::mt19937 random;  // NOLINT(bugprone-random-generator-seed): the same boxes each time
  std::uniform_real_distribution<float> coordinate;
  const float edge = std::cbrt(0.5F / static_cast<float>(n));
  std::vector<Aabb> boxes(n);
  for (Aabb& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = coordinate(random);
      box.upper[axis] = box.lower[axis] + edge;
    }
  }
  return boxes;
}

/// Measures updates with a finder, of boxes that do not move, some of which count as moved.
class Trial {
 public:
  struct Sample {
    double slots, work, seconds;
  };

  Trial(const opencl::Context& context, MakePairFinder make)
      : context_(context), engine_(context, profiler_, make, Order::Target::host) {}

  /// @param changed Of n boxes, evenly spread.
  Sample sample(std::size_t n, std::size_t changed) {
    set_boxes(n, changed);
    (void)seconds();  // which grows the buffers
    double shortest = seconds();
    double sum = shortest;
    for (int k = 1; k < fewest_searches || (k < most_searches && sum < long_enough); ++k) {
      const double taken = seconds();
      shortest = std::min(shortest, taken);
      sum += taken;
    }
    return {static_cast<double>(n), engine_.expected_work(search_), shortest};
  }

 private:
  void set_boxes(std::size_t n, std::size_t changed) {
    const cl::CommandQueue& queue = context_.queue();
    if (n != search_.now.slots) {
      const std::vector<Aabb> boxes = random_boxes(n);
      search_ = {.now = {.slots = static_cast<cl_uint>(n),
                         .boxes = context_.buffer((n + Generation::padding) * sizeof(Aabb))},
                 .last = search_.now};
      queue.enqueueWriteBuffer(search_.now.boxes, CL_TRUE, 0, n * sizeof(Aabb), boxes.data());
      (void)seconds();
      search_.last = search_.now;
    }
    search_.stamp = 1;
    std::vector<cl_uint> stamps(n);
    std::vector<cl_uint> slots(changed);
    for (std::size_t k = 0; k < changed; ++k) {
      slots[k] = static_cast<cl_uint>(k * (n / changed));
      stamps[slots[k]] = search_.stamp << 1U;
    }
    search_.all = changed == n;
    search_.changed_count = static_cast<cl_uint>(changed);
    search_.changed = context_.buffer(changed * sizeof(cl_uint));
    queue.enqueueWriteBuffer(search_.changed, CL_TRUE, 0, changed * sizeof(cl_uint), slots.data());
    search_.stamps = {};
    if (search_.all) return;
    search_.stamps = context_.buffer(n * sizeof(cl_uint));
    queue.enqueueWriteBuffer(search_.stamps, CL_TRUE, 0, n * sizeof(cl_uint), stamps.data());
  }

  double seconds() {
    const auto start = std::chrono::steady_clock::now();
    engine_.prepare();
    engine_.begin(search_);
    (void)engine_.finish();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }

  const opencl::Context& context_;
  opencl::Profiler profiler_{false};
  Engine engine_;
  Search search_;
};

CostModel measure_model(const opencl::Context& context, MakePairFinder make) {
  const Sizes sizes = sizes_for(context);
  Trial trial(context, make);
  const Trial::Sample few = trial.sample(sizes.few, sizes.few);
  std::size_t many = 2 * sizes.few;
  Trial::Sample all = trial.sample(many, many);
  while (many < sizes.many && all.seconds < long_enough) {
    many = std::min(sizes.many, 8 * many);
    all = trial.sample(many, many);
  }
  const Trial::Sample some = trial.sample(many, many / 8);
  const Trial::Sample one = trial.sample(many, 1);
  // Four equations for four terms. Noise must not make a term negative.
  const auto work = [&](const Trial::Sample& sample) {
    return std::max(sample.seconds - one.seconds, sample.seconds / 100) / (sample.work - one.work);
  };
  const double slot = std::max(one.seconds - few.seconds, one.seconds / 100) / (one.slots - few.slots);
  const double frame = std::max(few.seconds - slot * few.slots - work(all) * few.work, few.seconds / 2);
  return {.frame = frame, .slot = slot, .work = {work(some), work(all)}};
}

/// Contains the sizes and the kernel sources: if these change, the models are measured again.
std::string models_key(const opencl::Context& context) {
  const Sizes sizes = sizes_for(context);
  std::string key = "cost models, " + std::string(to_string(context.tuning())) + ", " +
                    std::to_string(sizes.few) + ", " + std::to_string(sizes.many);
  for (const opencl::KernelFile& file : opencl::embedded_kernel_files()) key += file.text;
  return key;
}

}  // namespace

std::array<CostModel, 2> calibrate(const opencl::Context& context,
                                   const std::array<MakePairFinder, 2>& finders) {
  std::array<CostModel, 2> models{};
  const auto stored = context.load(models_key(context));
  if (stored && stored->size() == sizeof models) {
    std::memcpy(models.data(), stored->data(), sizeof models);
    return models;
  }
  const opencl::Context own = context.with_own_memory();
  std::ranges::transform(finders, models.begin(),
                         [&](MakePairFinder make) { return measure_model(own, make); });
  store_models(context, models);
  return models;
}

void store_models(const opencl::Context& context, const std::array<CostModel, 2>& models) {
  opencl::DiskCache::Bytes bytes(sizeof models);
  std::memcpy(bytes.data(), models.data(), sizeof models);
  context.store(models_key(context), bytes);
}

}  // namespace broadcl
