// All pairs of a set of boxes, once: BroadCL beside other libraries that Debian packages.
//
// all-pairs/NAME/SET         wall time; pairs in any order, except BroadCL's, which are sorted
// all-pairs-sorted/NAME/SET  the same, and the pairs are sorted (std::sort)
//
// Counters: cpu_ms, the time of all processors; open_ms, the time to open a device and load its kernels,
// which is not part of the other times. The pairs of each library are compared with those of BroadCL's oracle
// or, for large sets, of its sweep-and-prune.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <CGAL/Box_intersection_d/Box_with_info_d.h>
#include <CGAL/box_intersection_d.h>
#include <benchmark/benchmark.h>
#include <embree3/rtcore.h>
#include <boost/geometry.hpp>
#include <boost/geometry/index/rtree.hpp>
#include <boost/iterator/function_output_iterator.hpp>

#include <broadcl/broad_phase.hpp>

#include "base/packed_boxes.hpp"
#include "cli/box_file.hpp"
#include "engines/algorithm.hpp"

namespace broadcl {
namespace {

using Pairs = std::vector<Pair>;

double cpu_seconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

Pair ordered(std::uint32_t s, std::uint32_t t) {
  return {std::min(s, t), std::max(s, t)};
}

/// Something that finds all pairs of a set of boxes, once.
using Finder = std::function<Pairs()>;
/// Makes one for a set; the time for this counts as opening.
using MakeFinder = std::function<Finder(const std::vector<Aabb>& boxes)>;

/// @param threads Of the host; 0: all.
Finder make_broadcl(const std::string& algorithm, std::size_t threads, const std::vector<Aabb>& boxes) {
  const Config config{.algorithm = algorithm, .threads = threads};
  if (!find_algorithm(algorithm).info.on_device) {
    return [config, &boxes] { return overlapping_pairs(boxes, {}, config); };
  }
  const std::shared_ptr<Algorithm> opened = make_algorithm(config);
  opened->reserve(boxes.size(), false);
  return [opened, threads, &boxes] {  // the rest of overlapping_pairs()
    pack_boxes(boxes, "", threads, opened->boxes());
    return opened->find_all({.boxes = opened->boxes().first(boxes.size()), .changed = {.all = true}});
  };
}

Finder make_cgal(const std::vector<Aabb>& boxes) {
  using Box = CGAL::Box_intersection_d::Box_with_info_d<float, 3, std::uint32_t>;
  return [&boxes] {
    std::vector<Box> items;
    items.reserve(boxes.size());
    for (std::uint32_t k = 0; k < boxes.size(); ++k) {
      std::array<float, 3> lower = boxes[k].lower;
      std::array<float, 3> upper = boxes[k].upper;
      items.emplace_back(lower.data(), upper.data(), k);
    }
    Pairs pairs;
    CGAL::box_self_intersection_d(
        items.begin(), items.end(),
        [&](const Box& s, const Box& t) { pairs.push_back(ordered(s.info(), t.info())); },
        CGAL::Box_intersection_d::Box_traits_d<Box>(), 200);
    return pairs;
  };
}

Finder make_boost(std::size_t threads, const std::vector<Aabb>& boxes) {
  namespace geometry = boost::geometry;
  using Point = geometry::model::point<float, 3, geometry::cs::cartesian>;
  using Box = geometry::model::box<Point>;
  using Item = std::pair<Box, std::uint32_t>;
  return [threads, &boxes] {
    std::vector<Item> items;
    items.reserve(boxes.size());
    for (std::uint32_t k = 0; k < boxes.size(); ++k) {
      const auto& [lower, upper] = boxes[k];
      items.emplace_back(Box(Point(lower[0], lower[1], lower[2]), Point(upper[0], upper[1], upper[2])), k);
    }
    const geometry::index::rtree<Item, geometry::index::quadratic<16>> tree(items);
    std::vector<Pairs> found(threads);
    const auto search = [&](std::size_t thread) {
      for (std::size_t k = items.size() * thread / threads; k < items.size() * (thread + 1) / threads; ++k) {
        const auto visit = [&](const Item& item) {
          if (item.second < items[k].second) found[thread].push_back({item.second, items[k].second});
        };
        tree.query(geometry::index::intersects(items[k].first), boost::make_function_output_iterator(visit));
      }
    };
    std::vector<std::thread> others;
    for (std::size_t thread = 1; thread < threads; ++thread) others.emplace_back(search, thread);
    search(0);
    for (std::thread& other : others) other.join();
    for (std::size_t thread = 1; thread < threads; ++thread) {
      found[0].insert(found[0].end(), found[thread].begin(), found[thread].end());
    }
    return std::move(found[0]);
  };
}

/// Embree's collision detection tests the bounds of leaves only, so boxes are tested again.
class Embree {
 public:
  explicit Embree(const std::vector<Aabb>& boxes) : boxes_(boxes), device_(rtcNewDevice(nullptr)) {}
  ~Embree() { rtcReleaseDevice(device_); }
  Embree(const Embree&) = delete;
  Embree& operator=(const Embree&) = delete;

  Pairs find() {
    const RTCScene scene = rtcNewScene(device_);
    const RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_USER);
    rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned>(boxes_.size()));
    rtcSetGeometryUserData(geometry, this);
    rtcSetGeometryBoundsFunction(
        geometry,
        [](const RTCBoundsFunctionArguments* arguments) {
          const Aabb& box = static_cast<Embree*>(arguments->geometryUserPtr)->boxes_[arguments->primID];
          *arguments->bounds_o = {.lower_x = box.lower[0],
                                  .lower_y = box.lower[1],
                                  .lower_z = box.lower[2],
                                  .align0 = 0,
                                  .upper_x = box.upper[0],
                                  .upper_y = box.upper[1],
                                  .upper_z = box.upper[2],
                                  .align1 = 0};
        },
        nullptr);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    pairs_.clear();
    rtcCollide(
        scene, scene,
        [](void* self, RTCCollision* collisions, unsigned count) {
          static_cast<Embree*>(self)->collect(collisions, count);
        },
        this);
    rtcReleaseScene(scene);
    return std::move(pairs_);
  }

 private:
  void collect(const RTCCollision* collisions, unsigned count) {
    thread_local Pairs own;
    own.clear();
    for (unsigned k = 0; k < count; ++k) {
      const unsigned s = collisions[k].primID0;
      const unsigned t = collisions[k].primID1;
      if (s < t && overlaps(boxes_[s], boxes_[t])) own.push_back({s, t});
    }
    const std::lock_guard lock(mutex_);
    pairs_.insert(pairs_.end(), own.begin(), own.end());
  }

  const std::vector<Aabb>& boxes_;
  RTCDevice device_;
  std::mutex mutex_;
  Pairs pairs_;
};

Finder make_embree(const std::vector<Aabb>& boxes) {
  const auto embree = std::make_shared<Embree>(boxes);
  return [embree] { return embree->find(); };
}

void time_all_pairs(benchmark::State& state, const MakeFinder& make, const std::vector<Aabb>& boxes,
                    bool sorted) {
  Pairs pairs = make(boxes)();  // compiles kernels, unless they are stored
  std::ranges::sort(pairs);
  const std::string reference = boxes.size() < 30000 ? "oracle" : "sweep-and-prune";
  if (pairs != overlapping_pairs(boxes, {}, {.algorithm = reference})) {
    return state.SkipWithError("the pairs are not those of BroadCL");
  }
  std::chrono::duration<double> open{};
  double cpu = 0;
  for ([[maybe_unused]] auto _ : state) {
    const auto opening = std::chrono::steady_clock::now();
    const Finder find = make(boxes);
    open += std::chrono::steady_clock::now() - opening;
    const double cpu_start = cpu_seconds();
    const auto start = std::chrono::steady_clock::now();
    Pairs found = find();
    if (sorted && !std::ranges::is_sorted(found)) std::ranges::sort(found);
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
    cpu += cpu_seconds() - cpu_start;
    state.SetIterationTime(taken.count());
  }
  state.counters["pairs"] = static_cast<double>(pairs.size());
  state.counters["open_ms"] = open.count() * 1e3 / static_cast<double>(state.iterations());
  state.counters["cpu_ms"] = cpu * 1e3 / static_cast<double>(state.iterations());
}

/// Cubes at random positions, with this many overlapping pairs per box.
std::vector<Aabb> random_cubes(std::size_t n, double pairs_per_box) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> coordinate;
  const auto edge = static_cast<float>(std::cbrt(pairs_per_box / (4 * static_cast<double>(n))));
  std::vector<Aabb> boxes(n);
  for (Aabb& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = coordinate(random);
      box.upper[axis] = box.lower[axis] + edge;
    }
  }
  return boxes;
}

void register_set(const std::string& name, const std::vector<Aabb>& boxes) {
  const std::size_t threads = std::max(1U, std::thread::hardware_concurrency());
  std::vector<std::pair<std::string, MakeFinder>> finders;
  for (const char* algorithm : {"tiles", "auto", "sweep-and-prune"}) {
    finders.emplace_back(std::string("broadcl-") + algorithm,
                         [=](const auto& set) { return make_broadcl(algorithm, 0, set); });
  }
  finders.emplace_back("broadcl-sweep-and-prune-1",
                       [](const auto& set) { return make_broadcl("sweep-and-prune", 1, set); });
  finders.emplace_back("cgal-1", make_cgal);
  finders.emplace_back("boost-1", [](const auto& set) { return make_boost(1, set); });
  finders.emplace_back("boost", [=](const auto& set) { return make_boost(threads, set); });
  finders.emplace_back("embree", make_embree);
  for (const auto& [finder, make] : finders) {
    for (const bool sorted : {false, true}) {
      if (sorted && finder.starts_with("broadcl")) continue;
      const std::string row = (sorted ? "all-pairs-sorted/" : "all-pairs/") + finder + "/" + name;
      benchmark::RegisterBenchmark(row.c_str(), time_all_pairs, make, boxes, sorted)
          ->UseManualTime()
          ->Iterations(5)
          ->Unit(benchmark::kMillisecond);
    }
  }
}

void register_all() {
  if (const char* folder = std::getenv("BROADCL_TEST_DATA")) {  // NOLINT(concurrency-mt-unsafe)
    for (const std::string set :
         {"cloth-funnel-faces", "cloth-funnel-edges", "cloth-ball-faces", "cloth-ball-edges"}) {
      register_set(set, cli::read_boxes(std::filesystem::path(folder) / (set + ".npy")).as_float32());
    }
  }
  for (const std::size_t n : {24'000U, 80'000U, 146'000U, 220'000U}) {
    for (const int pairs : {30, 120}) {
      register_set("cubes-" + std::to_string(pairs) + "/" + std::to_string(n), random_cubes(n, pairs));
    }
  }
}

}  // namespace
}  // namespace broadcl

int main(int argc, char** argv) try {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  broadcl::register_all();
  benchmark::RunSpecifiedBenchmarks();
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 2;
}
