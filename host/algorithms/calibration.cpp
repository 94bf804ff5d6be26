#include "algorithms/calibration.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include <broadcl/aabb.hpp>

#include "algorithms/pair_delta.hpp"
#include "algorithms/pair_finder.hpp"
#include "algorithms/scoped_timer.hpp"
#include "opencl/kernel_source.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {
namespace {

/// Few boxes tell what a frame costs whatever there is to do, many the rest; on slow devices fewer, as many
/// as take no longer than this.
constexpr std::size_t few_boxes = 128;
constexpr std::size_t many_boxes_of_cpu = 4096;
constexpr std::size_t many_boxes_of_gpu = 32768;
constexpr double long_search = 5e-3;  // seconds
constexpr int searches = 5;           // of which the shortest counts
/// Another grain than 1 must take no more than so much of its time.
constexpr double clearly_less = 0.9;

/// Cubes in the unit cube, of which each overlaps about four others.
std::vector<Aabb> random_boxes(std::size_t n) {
  std::mt19937 random;  // NOLINT(bugprone-random-generator-seed): the same boxes each time
  std::uniform_real_distribution<float> place;
  const float half_edge = std::cbrt(0.5F / static_cast<float>(n)) / 2;
  std::vector<Aabb> boxes(n);
  for (Aabb& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float centre = place(random);
      box.lower[axis] = centre - half_edge;
      box.upper[axis] = centre + half_edge;
    }
  }
  return boxes;
}

/// Times searches of boxes that stay where they are, and of which all or one count as moved.
class Trial {
 public:
  Trial(const opencl::Context& context, MakePairFinder make)
      : context_(context), finder_(make(context)), delta_(context, profiler_) {}

  void set_grain(double grain) { finder_->set_grain(grain); }
  [[nodiscard]] std::size_t pieces() const { return finder_->pieces(search_); }

  void set_boxes(std::size_t n) {
    const std::vector<Aabb> boxes = random_boxes(n);
    const cl::CommandQueue& queue = context_.queue();
    const cl::Buffer buffer = context_.buffer((n + Search::padding) * sizeof(Aabb));
    queue.enqueueWriteBuffer(buffer, CL_TRUE, 0, n * sizeof(Aabb), boxes.data());
    const cl::Buffer stamps = context_.buffer(n * sizeof(cl_uint));
    queue.enqueueFillBuffer(stamps, cl_uint{0}, 0, n * sizeof(cl_uint));
    constexpr cl_uint stamp = 1;
    queue.enqueueFillBuffer(stamps, cl_uint{stamp << 1}, 0, sizeof(cl_uint));
    const cl::Buffer changed = context_.buffer(sizeof(cl_uint));
    queue.enqueueFillBuffer(changed, cl_uint{0}, 0, sizeof(cl_uint));
    search_ = {.slots = static_cast<cl_uint>(n),
               .boxes = buffer,
               .filters = stamps,
               .changed = changed,
               .stamps = {.words = stamps, .stamp = stamp},
               .last_slots = search_.slots,
               .last_boxes = search_.slots > 0 ? search_.boxes : buffer,
               .last_filters = stamps};
    search();
    search_.last_slots = search_.slots;
    search_.last_boxes = search_.boxes;
  }

  /// What a search takes of the caller's time, at the least.
  double seconds(bool all) {
    search_.all = all;
    search_.changed_count = all ? 0 : 1;
    search();  // which makes room
    double shortest = std::numeric_limits<double>::infinity();
    for (int k = 0; k < searches; ++k) {
      double seconds = 0;
      {
        const ScopedTimer timer(seconds);
        search();
      }
      shortest = std::min(shortest, seconds);
    }
    return shortest;
  }

 private:
  void search() {
    delta_.begin({.search = search_, .find = [&] { finder_->find(search_, delta_, profiler_); }});
    (void)delta_.finish();
  }

  const opencl::Context& context_;
  opencl::Profiler profiler_{false};
  std::unique_ptr<PairFinder> finder_;
  PairDelta delta_;
  Search search_;
};

/// The grain with which a search of all is shortest; 1 where a search takes too long to try others.
/// @param of_all How long it takes with 1.
double best_grain(Trial& trial, double of_all) {
  if (of_all > long_search) return 1;
  double best = 1;
  const std::size_t pieces = trial.pieces();
  double shortest = clearly_less * of_all;
  for (const auto& [grain, name] : PairFinder::grains) {
    if (grain == 1) continue;
    trial.set_grain(grain);
    if (trial.pieces() == pieces) continue;
    const double seconds = trial.seconds(true);
    if (seconds >= shortest) continue;
    best = grain;
    shortest = seconds;
  }
  trial.set_grain(best);
  return best;
}

Calibration measure(const opencl::Context& context, const Contestant& contestant) {
  const std::size_t many = context.shape() == opencl::Shape::cpu ? many_boxes_of_cpu : many_boxes_of_gpu;
  const CostModel& model = contestant.model;
  Trial trial(context, contestant.make);
  std::size_t n = few_boxes;
  trial.set_boxes(n);
  double of_all = trial.seconds(true);
  const double frame = of_all * model.frame / model.seconds({.slots = n, .changed = n, .all = true});
  while (n < many && of_all < long_search) {
    n = std::min(many, 8 * n);
    trial.set_boxes(n);
    of_all = trial.seconds(true);
  }
  const double grain = context.grain() ? *context.grain() : best_grain(trial, of_all);
  if (grain != 1) of_all = trial.seconds(true);
  // What is too little to be measured is not nothing where there are more boxes.
  const double little = of_all / 100;
  const double of_slots = std::max(trial.seconds(false) - frame, little);
  const double of_changes = std::max(of_all - frame - of_slots, little);
  CostModel of_changes_only = model;
  of_changes_only.frame = of_changes_only.slot = 0;
  const double rest = of_changes / of_changes_only.seconds({.slots = n, .changed = n, .all = true});
  return {.model = {.frame = frame,
                    .slot = of_slots / static_cast<double>(n),
                    .change = model.change * rest,
                    .test = model.test * rest},
          .grain = grain};
}

/// Other kernels or models, or a grain that is asked for, are to be measured anew.
std::string key_of(const opencl::Context& context, const std::array<Contestant, 2>& contestants) {
  std::string key = context.shape() == opencl::Shape::cpu ? "calibration, cpu" : "calibration, gpu";
  if (context.grain()) key += ", grain " + std::to_string(*context.grain());
  for (const Contestant& contestant : contestants) {
    const CostModel& model = contestant.model;
    for (const double term : {model.frame, model.slot, model.change, model.test})
      key += " " + std::to_string(term * 1e12);
  }
  for (const opencl::KernelFile& file : opencl::embedded_kernel_files()) key += file.text;
  return key;
}

}  // namespace

std::array<Calibration, 2> calibrate(const opencl::Context& context,
                                     const std::array<Contestant, 2>& contestants) {
  static_assert(std::is_trivially_copyable_v<Calibration>);
  std::array<Calibration, 2> calibrations{};
  const std::string key = key_of(context, contestants);
  const auto kept = context.kept(key);
  if (kept && kept->size() == sizeof calibrations) {
    std::memcpy(calibrations.data(), kept->data(), sizeof calibrations);
    return calibrations;
  }
  const opencl::Context own(context.queue());  // whose memory is not the caller's
  for (std::size_t k = 0; k < calibrations.size(); ++k) calibrations[k] = measure(own, contestants[k]);
  opencl::DiskCache::Bytes bytes(sizeof calibrations);
  std::memcpy(bytes.data(), calibrations.data(), sizeof calibrations);
  context.keep(key, bytes);
  return calibrations;
}

}  // namespace broadcl
