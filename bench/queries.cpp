#include "benchmarks.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include <BulletCollision/BroadphaseCollision/btDbvt.h>
#include <benchmark/benchmark.h>

#include <broadcl/broad_phase.hpp>

#include "scenes/generators.hpp"

namespace broadcl {
namespace {

using scenes::MovingBoxes;
constexpr std::uint64_t seed_of_queries = 2;

Config one_thread(const std::string& algorithm = "sweep-and-prune") {
  return {.algorithm = algorithm, .threads = 1};
}

void time_batch(benchmark::State& state, std::uint32_t n, MovingBoxes::Sizes sizes, bool as_pairs) {
  const MovingBoxes objects(n, sizes);
  const MovingBoxes queries(n, sizes, seed_of_queries);
  BroadPhase broad_phase(one_thread());
  (void)broad_phase.update(objects.boxes());
  std::size_t hits = 0;
  for ([[maybe_unused]] auto _ : state) {
    if (as_pairs) {
      hits = overlapping_pairs(objects.boxes(), queries.boxes(), {}, one_thread()).size();
    } else {
      hits = broad_phase.overlapping(queries.boxes()).ids.size();
    }
  }
  state.counters["hits"] = static_cast<double>(hits);
}

/// A query at a time, or an object that takes the place of each query.
void time_single(benchmark::State& state, std::uint32_t n, bool as_object) {
  const MovingBoxes objects(n, MovingBoxes::Sizes::uniform);
  const MovingBoxes queries(n, MovingBoxes::Sizes::uniform, seed_of_queries);
  BroadPhase broad_phase(one_thread());
  (void)broad_phase.add(objects.boxes());
  const std::uint32_t id = broad_phase.add(queries.boxes()[0]);
  (void)broad_phase.update();
  std::vector<std::uint32_t> ids;
  std::size_t k = 0;
  for ([[maybe_unused]] auto _ : state) {
    const Aabb& box = queries.boxes()[k++ % n];
    if (as_object) {
      broad_phase.move(id, box);
      benchmark::DoNotOptimize(broad_phase.update().added.size());
    } else {
      benchmark::DoNotOptimize(broad_phase.overlapping(box, ids));
    }
  }
}

/// One percent of the boxes move, some queries follow, then an update.
void time_between(benchmark::State& state, std::uint32_t n, bool with_queries) {
  MovingBoxes objects(n, MovingBoxes::Sizes::uniform);
  BroadPhase broad_phase(one_thread());
  (void)broad_phase.add(objects.boxes());
  (void)broad_phase.update();
  std::vector<std::uint32_t> ids(n / 100);
  for (std::uint32_t k = 0; k < ids.size(); ++k) ids[k] = 100 * k;
  std::vector<Aabb> boxes(ids.size());
  std::vector<std::uint32_t> found;
  std::size_t next = 0;
  for ([[maybe_unused]] auto _ : state) {
    state.PauseTiming();
    objects.advance();
    for (std::size_t k = 0; k < ids.size(); ++k) boxes[k] = objects.boxes()[ids[k]];
    state.ResumeTiming();
    broad_phase.move(ids, boxes);
    if (with_queries) {
      for (std::size_t k = 0; k < 100; ++k)
        benchmark::DoNotOptimize(broad_phase.overlapping(objects.boxes()[next++ % n], found));
    }
    benchmark::DoNotOptimize(broad_phase.update().added.size());
  }
}

/// The first call after an update and a thousand in all.
void time_partners(benchmark::State& state, std::uint32_t n) {
  MovingBoxes objects(n, MovingBoxes::Sizes::uniform);
  BroadPhase broad_phase(one_thread());
  std::size_t partners = 0;
  for ([[maybe_unused]] auto _ : state) {
    state.PauseTiming();
    objects.advance();
    (void)broad_phase.update(objects.boxes());
    state.ResumeTiming();
    partners = 0;
    for (std::uint32_t k = 0; k < 1000; ++k) partners += broad_phase.partners(k * (n / 1000)).size();
  }
  state.counters["partners"] = static_cast<double>(partners);
}

/// Points in the unit cube, each with so many others within a distance, and that distance.
struct Points {
  explicit Points(std::size_t n, double others = 8.7) : boxes(n), steps(n) {
    distance = static_cast<float>(std::cbrt(others / static_cast<double>(n) * 3 / 4 / std::numbers::pi));
    std::mt19937 random(1);
    std::uniform_real_distribution<float> place(0, 1);
    std::uniform_real_distribution<float> step(-distance / 10, distance / 10);
    for (std::size_t k = 0; k < n; ++k) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        boxes[k].lower[axis] = boxes[k].upper[axis] = place(random);
        steps[k][axis] = step(random);
      }
    }
  }
  /// They go to and fro.
  void advance() {
    sign = -sign;
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      for (std::size_t axis = 0; axis < 3; ++axis)
        boxes[k].upper[axis] = boxes[k].lower[axis] += sign * steps[k][axis];
    }
  }
  /// Around the points, which overlap if these are within the distance along each axis.
  [[nodiscard]] std::vector<Aabb> cubes() const {
    std::vector<Aabb> cubes = boxes;
    for (Aabb& cube : cubes) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        cube.lower[axis] -= distance / 2;
        cube.upper[axis] += distance / 2;
      }
    }
    return cubes;
  }

  std::vector<Aabb> boxes;
  std::vector<std::array<float, 3>> steps;
  float distance = 0;
  float sign = 1;
};

void time_within(benchmark::State& state, std::uint32_t n) {
  const Points points(n);
  BroadPhase broad_phase(one_thread());
  (void)broad_phase.update(points.boxes);
  std::size_t hits = 0;
  for ([[maybe_unused]] auto _ : state)
    hits = broad_phase.overlapping(points.boxes, {.within = points.distance}).ids.size();
  state.counters["hits"] = static_cast<double>(hits);
}

/// The eight nearest of as many points, which are in random order; or all at the same place.
void time_nearest(benchmark::State& state, std::uint32_t n, bool equal) {
  std::vector<Aabb> points = Points(n).boxes;
  std::vector<Aabb> queries = points;
  std::shuffle(queries.begin(), queries.end(), std::mt19937(seed_of_queries));
  if (equal) points = queries = std::vector<Aabb>(n, points[0]);
  BroadPhase broad_phase(one_thread());
  (void)broad_phase.add(points);
  (void)broad_phase.nearest(queries, {.limit = 8});  // makes the tree
  for ([[maybe_unused]] auto _ : state)
    benchmark::DoNotOptimize(broad_phase.nearest(queries, {.limit = 8}).ids.data());
}

/// As many rays as boxes.
struct Rays {
  static constexpr float length = 0.1F;

  explicit Rays(std::uint32_t n)
      : objects(n, MovingBoxes::Sizes::uniform), starts(Points(n).boxes), directions(n) {
    std::mt19937 random(seed_of_queries);
    std::normal_distribution<float> any;
    for (auto& direction : directions) {
      for (float& component : direction) component = any(random);
      const float size = std::hypot(direction[0], direction[1], direction[2]);
      for (float& component : direction) component /= size;
    }
  }
  MovingBoxes objects;
  std::vector<Aabb> starts;
  std::vector<std::array<float, 3>> directions;
};

void time_along(benchmark::State& state, std::uint32_t n, std::uint32_t limit) {
  const Rays rays(n);
  BroadPhase broad_phase(one_thread());
  (void)broad_phase.update(rays.objects.boxes());
  std::size_t hits = 0;
  for ([[maybe_unused]] auto _ : state) {
    hits = broad_phase.along(rays.starts, rays.directions, {{Rays::length}}, {.limit = limit}).ids.size();
  }
  state.counters["hits"] = static_cast<double>(hits);
}

/// The same with the tree of Bullet's broad phase, all hits.
void time_along_tree(benchmark::State& state, std::uint32_t n) {
  struct Count final : btDbvt::ICollide {
    using ICollide::Process;
    void Process(const btDbvtNode* /*leaf*/) override { ++hits; }
    std::size_t hits = 0;
  };
  const Rays rays(n);
  const auto vector_of = [](const std::array<float, 3>& v) { return btVector3(v[0], v[1], v[2]); };
  btDbvt tree;
  for (const Aabb& box : rays.objects.boxes())
    tree.insert(btDbvtVolume::FromMM(vector_of(box.lower), vector_of(box.upper)), nullptr);
  btAlignedObjectArray<const btDbvtNode*> stack;
  Count count;
  for ([[maybe_unused]] auto _ : state) {
    count.hits = 0;
    for (std::size_t k = 0; k < n; ++k) {
      const btVector3 from = vector_of(rays.starts[k].lower);
      const btVector3 direction = vector_of(rays.directions[k]);
      btVector3 inverse;
      std::array<unsigned, 3> signs{};
      for (int axis = 0; axis < 3; ++axis) {
        inverse[axis] = direction[axis] == 0 ? btScalar(BT_LARGE_FLOAT) : 1 / direction[axis];
        signs.at(static_cast<std::size_t>(axis)) = inverse[axis] < 0 ? 1 : 0;
      }
      tree.rayTestInternal(tree.m_root, from, from + direction * Rays::length, inverse, signs.data(),
                           Rays::length, {0, 0, 0}, {0, 0, 0}, stack, count);
    }
  }
  state.counters["hits"] = static_cast<double>(count.hits);
}

void time_pairs_within(benchmark::State& state, std::uint32_t n, bool by_cubes) {
  const Points points(n);
  Config config = one_thread();
  if (!by_cubes) config.distance = points.distance;
  std::vector<Pair> pairs;
  for ([[maybe_unused]] auto _ : state) {
    if (by_cubes) {
      const float most = points.distance * points.distance;
      pairs = overlapping_pairs(points.cubes(), {}, config);
      std::erase_if(pairs, [&](const Pair& pair) {
        float sum = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const float gap = points.boxes[pair.a].lower[axis] - points.boxes[pair.b].lower[axis];
          sum += gap * gap;
        }
        return sum > most;
      });
    } else {
      pairs = overlapping_pairs(points.boxes, {}, config);
    }
  }
  state.counters["pairs"] = static_cast<double>(pairs.size());
}

void time_coming_within(benchmark::State& state, std::uint32_t n, const std::string& algorithm,
                        bool as_cubes) {
  Points points(n);
  Config config = one_thread(algorithm);
  if (!as_cubes) config.distance = points.distance;
  BroadPhase broad_phase(config);
  std::size_t changes = 0;
  std::vector<Aabb> boxes;
  const auto advance = [&] {
    points.advance();
    boxes = as_cubes ? points.cubes() : points.boxes;
  };
  for (int frame = 0; frame < 4; ++frame) {  // memory grows here, untimed
    advance();
    (void)broad_phase.update(boxes);
  }
  for ([[maybe_unused]] auto _ : state) {
    state.PauseTiming();
    advance();
    state.ResumeTiming();
    const Delta delta = broad_phase.update(boxes);
    changes = delta.added.size() + delta.removed.size();
  }
  state.counters["changes"] = static_cast<double>(changes);
}

}  // namespace

/// Benchmarks of queries and distances, on one thread of the host unless they name an algorithm:
///
///   queries/batch/SIZES/n           as many boxes as objects, of a broad phase that knows these
///   queries/batch/SIZES/n/as-pairs  the same by overlapping_pairs(objects, queries)
///   queries/one/n                   a box at a time
///   queries/one/n/as-object         the same by an object that goes there, and an update
///   queries/between/n               1 % of the objects move, 100 queries one at a time, an update
///   queries/between/n/without       the same without the queries
///   queries/partners/n              of a thousand objects after an update of all
///   queries/within/n                all points that are near each of them, about 8.7
///   queries/nearest/n               the eight nearest of each of as many points
///   queries/nearest/n/equal         the same if all points are equal
///   queries/along/n                 all boxes on as many rays of length 0.1 in the unit cube
///   queries/along/n/closest         only the first of each
///   queries/along/n/as-tree         all by btDbvt
///   distances/once/n                pairs of points within that distance, once
///   distances/once/n/as-cubes       the same by cubes that overlap, and a test of each pair
///   distances/ALGORITHM/n           which pairs of moving points came within it, and which left
///   distances/ALGORITHM/n/as-cubes  an update of cubes of that edge
void register_queries() {
  const auto add = [](const std::string& name, auto function, std::initializer_list<std::uint32_t> sizes,
                      const std::string& variant, auto... arguments) {
    for (const std::uint32_t n : sizes) {
      std::string full = name;
      full.append("/").append(std::to_string(n)).append(variant);
      benchmark::RegisterBenchmark(full.c_str(), function, n, arguments...)->Unit(benchmark::kMicrosecond);
    }
  };
  for (const bool other : {false, true}) {
    const auto variant = [other](const char* name) {
      return std::string(other ? "/" : "") + (other ? name : "");
    };
    add("queries/batch/uniform", time_batch, {10'000, 100'000, 1'000'000}, variant("as-pairs"),
        MovingBoxes::Sizes::uniform, other);
    add("queries/batch/mixed", time_batch, {10'000, 100'000}, variant("as-pairs"), MovingBoxes::Sizes::mixed,
        other);
    add("queries/one", time_single, {10'000, 100'000, 1'000'000}, variant("as-object"), other);
    add("queries/between", time_between, {100'000}, variant("without"), !other);
    add("distances/once", time_pairs_within, {100'000, 1'000'000}, variant("as-cubes"), other);
    for (const std::string algorithm : {"sweep-and-prune", "tiles"})
      add("distances/" + algorithm, time_coming_within, {100'000, 1'000'000}, variant("as-cubes"), algorithm,
          other);
  }
  add("queries/partners", time_partners, {100'000}, "");
  add("queries/nearest", time_nearest, {10'000, 100'000, 1'000'000}, "", false);
  add("queries/nearest", time_nearest, {10'000, 100'000}, "/equal", true);
  add("queries/along", time_along, {10'000, 100'000, 1'000'000}, "", QueryOptions::all);
  add("queries/along", time_along, {10'000, 100'000, 1'000'000}, "/closest", 1U);
  add("queries/along", time_along_tree, {10'000, 100'000, 1'000'000}, "/as-tree");
  add("queries/within", time_within, {100'000, 1'000'000}, "");
}

}  // namespace broadcl
