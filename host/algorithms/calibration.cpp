#include "algorithms/calibration.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include <broadcl/aabb.hpp>

#include "algorithms/engine.hpp"
#include "opencl/kernel_source.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {
namespace {

/// A few boxes show the fixed cost of a frame, many boxes the rest.
constexpr std::size_t few_boxes = 128;
constexpr std::size_t many_boxes_of_cpu = 4096;
constexpr std::size_t many_boxes_of_gpu = 32768;
/// The shortest search counts: of at least `fewest_searches`, and of up to `most_searches` until they have
/// taken `long_enough` together.
constexpr int fewest_searches = 5;
constexpr int most_searches = 100;
constexpr double long_enough = 5e-3;  // seconds

/// Cubes in the unit cube, each of which overlaps about four others.
std::vector<Aabb> random_boxes(std::size_t n) {
  std::mt19937 random;  // NOLINT(bugprone-random-generator-seed): the same boxes each time
  std::uniform_real_distribution<float> coordinate;
  const float half_edge = std::cbrt(0.5F / static_cast<float>(n)) / 2;
  std::vector<Aabb> boxes(n);
  for (Aabb& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float centre = coordinate(random);
      box.lower[axis] = centre - half_edge;
      box.upper[axis] = centre + half_edge;
    }
  }
  return boxes;
}

/// Measures updates with a finder, of boxes that do not move, all or one of which count as moved.
class Trial {
 public:
  struct Sample {
    double slots, work, seconds;
  };

  Trial(const opencl::Context& context, MakePairFinder make)
      : context_(context), engine_(context, profiler_, make, Order::Target::host) {}

  Sample sample(std::size_t n, bool all) {
    if (n != search_.now.slots) set_boxes(n);
    search_.all = all;
    search_.changed_count = all ? 0 : 1;
    (void)seconds();  // which grows the buffers
    double shortest = std::numeric_limits<double>::infinity();
    double sum = 0;
    for (int k = 0; k < fewest_searches || (k < most_searches && sum < long_enough); ++k) {
      const double taken = seconds();
      shortest = std::min(shortest, taken);
      sum += taken;
    }
    return {static_cast<double>(n), engine_.expected_work(search_), shortest};
  }

 private:
  void set_boxes(std::size_t n) {
    const std::vector<Aabb> boxes = random_boxes(n);
    const cl::CommandQueue& queue = context_.queue();
    const cl::Buffer buffer = context_.buffer((n + Generation::padding) * sizeof(Aabb));
    queue.enqueueWriteBuffer(buffer, CL_TRUE, 0, n * sizeof(Aabb), boxes.data());
    const cl::Buffer stamps = context_.buffer(n * sizeof(cl_uint));
    queue.enqueueFillBuffer(stamps, cl_uint{0}, 0, n * sizeof(cl_uint));
    constexpr cl_uint stamp = 1;
    queue.enqueueFillBuffer(stamps, cl_uint{stamp << 1}, 0, sizeof(cl_uint));
    const cl::Buffer changed = context_.buffer(sizeof(cl_uint));
    queue.enqueueFillBuffer(changed, cl_uint{0}, 0, sizeof(cl_uint));
    const Generation last = search_.now;
    search_ = {.now = {.slots = static_cast<cl_uint>(n), .boxes = buffer},
               .last = last,
               .changed = changed,
               .stamp = stamp,
               .stamps = stamps};
    (void)seconds();
    search_.last = search_.now;
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

CostModel measure(const opencl::Context& context, MakePairFinder make) {
  const std::size_t many = context.tuning() == opencl::Tuning::cpu ? many_boxes_of_cpu : many_boxes_of_gpu;
  Trial trial(context, make);
  const Trial::Sample few = trial.sample(few_boxes, true);
  const Trial::Sample all = trial.sample(many, true);
  const Trial::Sample one = trial.sample(many, false);
  // Three equations for three terms, none of which may turn negative because of noise.
  const double work = std::max(all.seconds - one.seconds, all.seconds / 100) / (all.work - one.work);
  const double rest = one.seconds - few.seconds - work * (one.work - few.work);
  const double slot = std::max(rest, all.seconds / 100) / (one.slots - few.slots);
  const double frame = std::max(few.seconds - slot * few.slots - work * few.work, few.seconds / 2);
  return {.frame = frame, .slot = slot, .work = work};
}

/// Contains the kernels: if they change, they are measured again.
std::string key_of(const opencl::Context& context) {
  std::string key = context.tuning() == opencl::Tuning::cpu ? "cost models, cpu" : "cost models, gpu";
  for (const opencl::KernelFile& file : opencl::embedded_kernel_files()) key += file.text;
  return key;
}

}  // namespace

std::array<CostModel, 2> calibrate(const opencl::Context& context,
                                   const std::array<MakePairFinder, 2>& finders) {
  std::array<CostModel, 2> models{};
  static_assert(std::is_trivially_copyable_v<CostModel>);
  const std::string key = key_of(context);
  const auto stored = context.load(key);
  if (stored && stored->size() == sizeof models) {
    std::memcpy(models.data(), stored->data(), sizeof models);
    return models;
  }
  const opencl::Context own(context.queue());  // so that its memory does not count as the caller's
  std::ranges::transform(finders, models.begin(), [&](MakePairFinder make) { return measure(own, make); });
  opencl::DiskCache::Bytes bytes(sizeof models);
  std::memcpy(bytes.data(), models.data(), sizeof models);
  context.store(key, bytes);
  return models;
}

}  // namespace broadcl
