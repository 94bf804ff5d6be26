#include "benchmarks.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numeric>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/CollisionDispatch/btCollisionDispatcher.h>
#include <BulletCollision/CollisionDispatch/btCollisionObject.h>
#include <BulletCollision/CollisionDispatch/btCollisionWorld.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>
#include <BulletCollision/CollisionShapes/btSphereShape.h>
#include <benchmark/benchmark.h>

#include <broadcl/bullet.hpp>

#include "bounds.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/random.hpp"

namespace broadcl {
namespace {

using scenes::MovingBoxes;

constexpr std::string_view stock = "+stock";
constexpr std::array names{"brute-force", "tiles", "tiles+stock", "bullet-bvh", "bullet-sap"};

/// A broad phase with one proxy per box, not all of which exist at a time.
class Proxies {
 public:
  Proxies(std::string_view name, const MovingBoxes& boxes)
      : broadphase_(make(name, boxes)), boxes_(scaled(boxes)), proxies_(boxes_.size()) {
    // Load the kernels on the device.
    create(std::array{std::size_t{0}, std::size_t{1}});
    calculate();
    destroy(std::array{std::size_t{0}, std::size_t{1}});
    calculate();
  }
  ~Proxies() {
    for (btBroadphaseProxy* proxy : proxies_) {
      if (proxy != nullptr) broadphase_->destroyProxy(proxy, &dispatcher_);
    }
  }
  Proxies(const Proxies&) = delete;
  Proxies& operator=(const Proxies&) = delete;
  Proxies(Proxies&&) = delete;
  Proxies& operator=(Proxies&&) = delete;

  void create(std::span<const std::size_t> which) {
    for (const std::size_t k : which) {
      proxies_[k] = broadphase_->createProxy(boxes_[k].lower, boxes_[k].upper, BOX_SHAPE_PROXYTYPE, this, 1,
                                             -1, &dispatcher_);
    }
  }
  void destroy(std::span<const std::size_t> which) {
    for (const std::size_t k : which) {
      broadphase_->destroyProxy(proxies_[k], &dispatcher_);
      proxies_[k] = nullptr;
    }
  }
  void move(std::span<const Bounds> boxes) {
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      broadphase_->setAabb(proxies_[k], boxes[k].lower, boxes[k].upper, &dispatcher_);
    }
  }
  void calculate() { broadphase_->calculateOverlappingPairs(&dispatcher_); }
  void ray(const btVector3& from, const btVector3& to) {
    Ray ray(from, to);
    broadphase_->rayTest(from, to, ray);
  }
  [[nodiscard]] int pair_count() const {
    return broadphase_->getOverlappingPairCache()->getNumOverlappingPairs();
  }

 private:
  /// Finds all proxies on its way.
  struct Ray final : btBroadphaseRayCallback {
    Ray(const btVector3& from, const btVector3& to) {
      m_lambda_max = from.distance(to);
      const btVector3 direction = (to - from) / m_lambda_max;
      for (int axis = 0; axis < 3; ++axis) {
        m_rayDirectionInverse[axis] = direction[axis] == 0 ? btScalar(BT_LARGE_FLOAT) : 1 / direction[axis];
        m_signs[axis] = direction[axis] < 0 ? 1 : 0;
      }
    }
    bool process(const btBroadphaseProxy* /*proxy*/) override { return true; }
  };

  std::unique_ptr<btBroadphaseInterface> make(std::string_view name, const MovingBoxes& boxes) {
    if (name.ends_with(stock)) {
      const std::string algorithm(name.substr(0, name.size() - stock.size()));
      return std::make_unique<BulletBroadphase>(Config{.algorithm = algorithm}, &stock_cache_);
    }
    // Above 16,384 objects the axis sweep is the 32-bit one.
    return scenes::make_broadphase({.name = std::string(name),
                                    .device = {},
                                    .objects = boxes.boxes().size() + 16385,
                                    .world_edge = 4 / boxes.edge()});
  }

  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btHashedOverlappingPairCache stock_cache_;
  std::unique_ptr<btBroadphaseInterface> broadphase_;
  std::vector<Bounds> boxes_;
  std::vector<btBroadphaseProxy*> proxies_;  // null for boxes without a proxy
};

std::vector<std::size_t> numbers(std::size_t first, std::size_t count) {
  std::vector<std::size_t> result(count);
  std::iota(result.begin(), result.end(), first);
  return result;
}

/// A random subset of 0 .. of - 1, in random order.
std::vector<std::size_t> sample(std::size_t count, std::size_t of) {
  std::vector<std::size_t> result = numbers(0, of);
  scenes::Random(1).shuffle(std::span(result));
  result.resize(count);
  return result;
}

template <class Function>
void time(benchmark::State& state, Proxies& proxies, Function&& change) {
  const auto start = std::chrono::steady_clock::now();
  change();
  proxies.calculate();
  state.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  state.counters["overlapping"] = proxies.pair_count();
}

void time_create(benchmark::State& state, const char* name, MovingBoxes::Sizes sizes, std::uint32_t n) {
  for ([[maybe_unused]] auto _ : state) {
    Proxies proxies(name, MovingBoxes(n, sizes));
    time(state, proxies, [&, all = numbers(0, n)] { proxies.create(all); });
  }
}

void time_create_more(benchmark::State& state, const char* name, MovingBoxes::Sizes sizes, std::uint32_t n) {
  for ([[maybe_unused]] auto _ : state) {
    Proxies proxies(name, MovingBoxes(2 * n, sizes));
    proxies.create(numbers(0, n));
    proxies.calculate();
    time(state, proxies, [&, more = numbers(n, n)] { proxies.create(more); });
  }
}

void time_destroy(benchmark::State& state, const char* name, MovingBoxes::Sizes sizes, std::uint32_t n) {
  const std::uint32_t all = 2 * n;
  for ([[maybe_unused]] auto _ : state) {
    Proxies proxies(name, MovingBoxes(all, sizes));
    proxies.create(numbers(0, all));
    proxies.calculate();
    time(state, proxies, [&, half = sample(n, all)] { proxies.destroy(half); });
  }
}

void time_move(benchmark::State& state, const char* name, MovingBoxes::Sizes sizes, std::uint32_t n) {
  MovingBoxes boxes(n, sizes);
  Proxies proxies(name, boxes);
  proxies.create(numbers(0, n));
  proxies.calculate();
  for ([[maybe_unused]] auto _ : state) {
    boxes.advance();
    time(state, proxies, [&, moved = scaled(boxes)] { proxies.move(moved); });
  }
}

void time_rays(benchmark::State& state, const char* name, MovingBoxes::Sizes sizes, std::uint32_t n) {
  MovingBoxes boxes(n, sizes);
  Proxies proxies(name, boxes);
  proxies.create(numbers(0, n));
  for ([[maybe_unused]] auto _ : state) {
    boxes.advance();
    const std::vector<Bounds> moved = scaled(boxes);
    const auto start = std::chrono::steady_clock::now();
    proxies.move(moved);
    proxies.calculate();
    for (std::size_t k = 0; k < 100; ++k) proxies.ray(moved[k].lower, moved[n - 1 - k].upper);
    state.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
}

/// 50 or 500 rays among 3,500 objects.
/// @param moving How many of them move.
void time_ray_stage(benchmark::State& state, const char* name, std::uint32_t moving, std::size_t rays) {
  constexpr std::uint32_t n = 3500;
  MovingBoxes boxes(n, MovingBoxes::Sizes::uniform);
  Proxies proxies(name, boxes);
  proxies.create(numbers(0, n));
  proxies.calculate();
  double frame = 0;
  for ([[maybe_unused]] auto _ : state) {
    boxes.advance();
    const std::vector<Bounds> moved = scaled(boxes);
    const auto start = std::chrono::steady_clock::now();
    proxies.move(std::span(moved).first(moving));
    proxies.calculate();
    const auto middle = std::chrono::steady_clock::now();
    for (std::size_t k = 0; k < rays; ++k) proxies.ray(moved[k].lower, moved[n - 1 - k].upper);
    const auto end = std::chrono::steady_clock::now();
    state.SetIterationTime(std::chrono::duration<double>(end - middle).count());
    frame += std::chrono::duration<double, std::milli>(end - start).count();
  }
  state.counters["frame"] = benchmark::Counter(frame, benchmark::Counter::kAvgIterations);
}

/// The objects touch their neighbours.
template <class Broadphase>
void time_life(benchmark::State& state, std::size_t n) {
  btDefaultCollisionConfiguration configuration;
  btSphereShape ball(1);
  std::vector<btCollisionObject> objects(n);
  for (std::size_t k = 0; k < n; ++k) {
    objects[k].setCollisionShape(&ball);
    objects[k].getWorldTransform().setOrigin({btScalar(k), 0, 0});
  }
  for ([[maybe_unused]] auto _ : state) {
    btCollisionDispatcher dispatcher(&configuration);
    Broadphase broadphase;
    btCollisionWorld world(&dispatcher, &broadphase, &configuration);
    for (btCollisionObject& object : objects) world.addCollisionObject(&object);
    broadphase.calculateOverlappingPairs(&dispatcher);
    for (btCollisionObject& object : objects) world.removeCollisionObject(&object);
  }
}

/// Boxes with edges of 1.2 that are added, and their first calculation in the counter.
/// @param distance Between them, in a square grid; 0 if all are at one place.
/// @param rules The filter group and the filter mask of each.
template <class Broadphase>
void time_add(benchmark::State& state, std::size_t n, btScalar distance, std::pair<int, int> rules) {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  const auto columns = static_cast<std::size_t>(std::sqrt(n));
  const btVector3 edges(1.2F, 1.2F, 1.2F);
  double first = 0;
  for ([[maybe_unused]] auto _ : state) {
    Broadphase broadphase;
    std::vector<btBroadphaseProxy*> proxies(n);
    const auto start = std::chrono::steady_clock::now();
    for (std::size_t k = 0; k < n; ++k) {
      const std::size_t row = k / columns;
      const btVector3 lower = distance * btVector3(btScalar(k % columns), 0, btScalar(row));
      proxies[k] = broadphase.createProxy(lower, lower + edges, BOX_SHAPE_PROXYTYPE, &state, rules.first,
                                          rules.second, &dispatcher);
    }
    const auto added = std::chrono::steady_clock::now();
    broadphase.calculateOverlappingPairs(&dispatcher);
    first += std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - added).count();
    state.SetIterationTime(std::chrono::duration<double>(added - start).count());
    for (btBroadphaseProxy* proxy : proxies) broadphase.destroyProxy(proxy, &dispatcher);
  }
  state.counters["first_calculation"] = benchmark::Counter(first, benchmark::Counter::kAvgIterations);
}

template <class Broadphase>
void register_add(const std::string& name) {
  const auto add = [&](const char* scene, std::size_t n, btScalar distance, std::pair<int, int> rules) {
    const std::string row = "proxies/add/" + name + "/" + scene + "/" + std::to_string(n);
    benchmark::RegisterBenchmark(row.c_str(), time_add<Broadphase>, n, distance, rules)
        ->UseManualTime()
        ->Iterations(1)
        ->Unit(benchmark::kMillisecond);
  };
  add("one-place", 3000, 0, {btBroadphaseProxy::DefaultFilter, btBroadphaseProxy::AllFilter});
  constexpr int others = btBroadphaseProxy::AllFilter ^ btBroadphaseProxy::StaticFilter;
  add("static", 50'000, 1, {btBroadphaseProxy::StaticFilter, others});
}

void time_teleport(benchmark::State& state, const char* name, MovingBoxes::Sizes sizes, std::uint32_t n) {
  Proxies proxies(name, MovingBoxes(n, sizes));
  proxies.create(numbers(0, n));
  proxies.calculate();
  std::uint64_t seed = 1;
  for ([[maybe_unused]] auto _ : state) {
    const std::vector<Bounds> elsewhere = scaled(MovingBoxes(n, sizes, ++seed));
    time(state, proxies, [&] { proxies.move(elsewhere); });
  }
}

void time_stream(benchmark::State& state, const char* name, MovingBoxes::Sizes sizes, std::uint32_t n) {
  Proxies proxies(name, MovingBoxes(n, sizes));
  proxies.create(numbers(0, n));
  proxies.calculate();
  const std::vector<std::size_t> tenth = sample(n / 10, n);
  for ([[maybe_unused]] auto _ : state) {
    time(state, proxies, [&] {
      proxies.destroy(tenth);
      proxies.create(tenth);
    });
  }
}

struct Operation {
  const char* name;
  void (*function)(benchmark::State&, const char*, MovingBoxes::Sizes, std::uint32_t);
  int frames;
};
constexpr std::array operations{
    Operation{"create", time_create, 1},   Operation{"create-more", time_create_more, 1},
    Operation{"move", time_move, 5},       Operation{"teleport", time_teleport, 2},
    Operation{"destroy", time_destroy, 1}, Operation{"stream", time_stream, 5},
    Operation{"rays", time_rays, 20}};

}  // namespace

/// Benchmarks of proxies that come, move and go, through Bullet's interface. Each ends with
/// calculateOverlappingPairs(), and so with a correct pair cache:
///
///   proxies/create/NAME/SCENE/N        N proxies are created in an empty broad phase
///   proxies/create-more/NAME/SCENE/N   N proxies are created among N others
///   proxies/move/NAME/SCENE/N          all N proxies move by a tenth of their edge
///   proxies/teleport/NAME/SCENE/N      all N proxies move to positions unrelated to the old ones
///   proxies/destroy/NAME/SCENE/N       N of 2 N proxies are destroyed in random order
///   proxies/stream/NAME/SCENE/N        the same tenth of N proxies is destroyed and created again
///   proxies/rays/NAME/SCENE/N          all N proxies move, then 100 rays are cast
///   proxies/ray-stage/NAME/MOVING/RAYS that many rays among 3,500 proxies, MOVING of which moved; `frame`
///   has the
///                                      milliseconds of the whole frame
///   proxies/add/NAME/one-place/N       N proxies are created at one place; `first_calculation` has the
///                                      milliseconds of the calculation after it, which is not in the time
///   proxies/add/NAME/static/N          the same with N static ones, each of which overlaps its neighbours
///   proxies/life/NAME/N                a world is made, gets N objects, and is destroyed after a calculation
///
/// NAME is one of scenes::broadphases(), with `+stock` if a BulletBroadphase is given a
/// btHashedOverlappingPairCache. bullet-sap is bt32BitAxisSweep3.
void register_proxies() {
  for (const auto& [name, function] : {std::pair("auto", &time_life<BulletBroadphase>),
                                       std::pair("bullet-bvh", &time_life<btDbvtBroadphase>)}) {
    for (const std::size_t n : {0U, 1U, 2U, 5U, 16U}) {
      const std::string row = std::string("proxies/life/") + name + "/" + std::to_string(n);
      benchmark::RegisterBenchmark(row.c_str(), function, n)->Unit(benchmark::kMicrosecond);
    }
  }
  register_add<BulletBroadphase>("auto");
  register_add<btDbvtBroadphase>("bullet-bvh");
  for (const char* name : {"sweep-and-prune", "bullet-bvh"}) {
    for (const auto& [moving, rays] :
         {std::pair(500U, std::size_t{50}), std::pair(3500U, std::size_t{500})}) {
      const std::string row = std::string("proxies/ray-stage/") + name + "/" + std::to_string(moving) + "/" +
                              std::to_string(rays);
      benchmark::RegisterBenchmark(row.c_str(), time_ray_stage, name, moving, rays)
          ->UseManualTime()
          ->Iterations(100)
          ->Unit(benchmark::kMicrosecond);
    }
  }
  for (const Operation& operation : operations) {
    for (const auto& [scene, sizes] :
         {std::pair("uniform", MovingBoxes::Sizes::uniform), std::pair("mixed", MovingBoxes::Sizes::mixed)}) {
      for (const std::uint32_t n : {500U, 10000U}) {
        for (const char* name : names) {
          const std::string row =
              std::string("proxies/") + operation.name + "/" + name + "/" + scene + "/" + std::to_string(n);
          benchmark::RegisterBenchmark(row.c_str(), operation.function, name, sizes, n)
              ->UseManualTime()
              ->Iterations(operation.frames)
              ->Unit(benchmark::kMillisecond);
        }
      }
    }
  }
}

}  // namespace broadcl
