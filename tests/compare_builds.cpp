// compare_builds [--most RATIO] LIBBROADCL.SO ...: updates the same boxes with some builds of the library.
// With --most, fails if one needs more than RATIO times the CPU time of the first.
#include <dlfcn.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <limits>
#include <numeric>
#include <random>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <broadcl/broadcl.h>

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

constexpr std::size_t frames = 30;

/// Boxes of mixed sizes, each of which overlaps a few others.
class MovingBoxes {
 public:
  explicit MovingBoxes(std::size_t count) : boxes_(count), steps_(3 * count) {
    std::mt19937 random(1);
    std::uniform_real_distribution<float> position(0, std::cbrt(static_cast<float>(count)));
    std::uniform_real_distribution<float> size(0.3F, 1.2F);
    std::uniform_real_distribution<float> step(-0.02F, 0.02F);
    for (broadcl_aabb& box : boxes_) {
      const float edge = size(random);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box.lower[axis] = position(random);
        box.upper[axis] = box.lower[axis] + edge;
      }
    }
    for (float& one : steps_) one = step(random);
  }

  void move() {
    for (std::size_t k = 0; k < steps_.size(); ++k) {
      boxes_[k / 3].lower[k % 3] += steps_[k];
      boxes_[k / 3].upper[k % 3] += steps_[k];
    }
  }
  [[nodiscard]] broadcl_boxes get() const {
    return {sizeof(broadcl_boxes), boxes_.data(), boxes_.size(), 0, BROADCL_FLOAT32, 3};
  }

 private:
  std::vector<broadcl_aabb> boxes_;
  std::vector<float> steps_;
};

/// A build of the library, with a broad phase.
class Build {
 public:
  explicit Build(const std::string& path) : library_(dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    if (library_ == nullptr) throw std::runtime_error(dlerror());
  }

  void begin() {
    broadcl_config config{};
    config.size = sizeof config;
    config.algorithm = "sweep-and-prune";
    config.threads = 1;
    check(
        function<decltype(broadcl_broad_phase_create)>("broadcl_broad_phase_create")(&config, &broad_phase_));
  }
  broadcl_delta update(const broadcl_boxes& boxes) {
    broadcl_delta delta{};
    check(update_(broad_phase_, &boxes, &delta));
    return delta;
  }
  void end() {
    check(function<decltype(broadcl_broad_phase_destroy)>("broadcl_broad_phase_destroy")(broad_phase_));
  }

 private:
  template <class Function>
  [[nodiscard]] Function* function(const char* name) const {
    void* const address = dlsym(library_, name);
    if (address == nullptr) throw std::runtime_error(dlerror());
    return reinterpret_cast<Function*>(address);
  }
  void check(broadcl_status status) const {
    if (status != BROADCL_SUCCESS)
      throw std::runtime_error(function<decltype(broadcl_last_error)>("broadcl_last_error")());
  }

  void* library_;
  decltype(broadcl_broad_phase_update_boxes)* update_ =
      function<decltype(broadcl_broad_phase_update_boxes)>("broadcl_broad_phase_update_boxes");
  broadcl_broad_phase* broad_phase_ = nullptr;
};

double cpu_seconds() {
  std::timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// The CPU time of all frames, by build. The builds take turns, and of each frame the shortest time counts.
std::vector<double> times(std::vector<Build>& builds, std::size_t boxes, std::size_t repetitions) {
  std::vector<std::vector<double>> shortest(builds.size(), std::vector<double>(frames, infinity));
  for (std::size_t repetition = 0; repetition < repetitions; ++repetition) {
    MovingBoxes moving(boxes);
    for (Build& build : builds) build.begin();
    for (std::size_t frame = 0; frame < frames; ++frame) {
      std::size_t pairs = 0;
      for (std::size_t k = 0; k < builds.size(); ++k) {
        const std::size_t turn = (frame + repetition + k) % builds.size();
        const double start = cpu_seconds();
        const broadcl_delta delta = builds[turn].update(moving.get());
        double& time = shortest[turn][frame];
        time = std::min(time, cpu_seconds() - start);
        if (k == 0) pairs = delta.added.count;
        if (delta.added.count != pairs) throw std::runtime_error("the builds find different pairs");
      }
      if (frame == 0 && pairs < boxes) throw std::runtime_error("few boxes overlap");
      moving.move();
    }
    for (Build& build : builds) build.end();
  }
  std::vector<double> sums(builds.size());
  std::ranges::transform(shortest, sums.begin(), [](const std::vector<double>& of_frames) {
    return std::accumulate(of_frames.begin() + 1, of_frames.end(), 0.0);
  });
  return sums;
}

}  // namespace

int main(int argc, char** argv) try {
  std::vector<std::string> paths(argv + 1, argv + argc);
  double most = infinity;
  std::size_t repetitions = 1;
  if (paths.size() > 2 && paths[0] == "--most") {
    most = std::stod(paths[1]);
    repetitions = 10;
    paths.erase(paths.begin(), paths.begin() + 2);
  }
  std::vector<Build> builds(paths.begin(), paths.end());
  bool is_slow = false;
  for (const std::size_t boxes : {16'000U, 100'000U}) {
    const std::vector<double> seconds = times(builds, boxes, repetitions);
    for (std::size_t k = 0; k < builds.size(); ++k) {
      const double ratio = seconds[k] / seconds[0];
      std::printf("%6zu boxes: %6.3f ms, %.2f times the first, with %s\n", boxes,
                  1e3 * seconds[k] / (frames - 1), ratio, paths[k].c_str());
      is_slow = is_slow || ratio > most;
    }
  }
  return is_slow ? EXIT_FAILURE : EXIT_SUCCESS;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return EXIT_FAILURE;
}
