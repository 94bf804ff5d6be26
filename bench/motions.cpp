// What a frame costs whatever moves, in which way:
//
//   build-dev/bench/broadcl_motions
//
// A row is a scene of scenes/motions.hpp with a number of objects. Times are of the calls of a frame alone,
// CPU time of the process with one thread on the host, otherwise wall time, in ms: the median, and the p99.9
// and the longest; then, as multiples, the median of the last quarter of the frames (of that of the first),
// of trembling as many boxes (in the same run), and of "again": overlapping_pairs() of the boxes of the last
// frame, whose time is the last column. For rows of Bullet, which are whole frames, "again" is
// btDbvtBroadphase.
//
// With --double, a row is a scene of scenes/clusters.hpp: a BroadPhase64 plays it with clusters far apart,
// and a BroadPhase with the same boxes near 0, in turns. Times of frames are means.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <iterator>
#include <map>
#include <memory>
#include <optional>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include <ctime>

#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>
#include <BulletCollision/CollisionDispatch/btGhostObject.h>
#include <BulletCollision/CollisionShapes/btBoxShape.h>
#include <BulletDynamics/ConstraintSolver/btSequentialImpulseConstraintSolver.h>
#include <BulletDynamics/Dynamics/btDiscreteDynamicsWorld.h>
#include <BulletDynamics/Dynamics/btRigidBody.h>
#include <CLI/CLI.hpp>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>
#include <broadcl/bullet.hpp>

#include "scenes/clusters.hpp"
#include "scenes/motions.hpp"
#include "scenes/random.hpp"

namespace broadcl::bench {
namespace {

using scenes::Clusters;
using scenes::ClustersInfo;
using scenes::Motion;
using scenes::MotionFrame;
using scenes::MotionInfo;

struct Row {
  std::string scene;
  std::uint32_t objects;
  std::size_t frames = 200;

  [[nodiscard]] std::string name() const { return scene + "/" + std::to_string(objects); }
};

struct Options {
  Config config{.algorithm = "sweep-and-prune", .threads = 1};
  std::string rows = ".*";
  std::uint32_t objects = 0;
  std::size_t frames = 0;
  bool wall = false;
  bool growth = false;
  bool in_double = false;
  bool list = false;
};

/// Scenes with several numbers, or with another number than the others. Trembling comes first.
const std::vector<Row> special_rows{
    {"tremble", 16, 2000},
    {"tremble", 17, 2000},
    {"tremble", 100, 2000},
    {"tremble", 16'000},
    {"tremble", 20'000},
    {"tremble", 100'000},
    {"tremble", 1'000'000, 20},
    {"tremble-0.1%", 1'000'000, 50},
    {"tremble-1%", 16'000, 2000},
    {"tremble-1%", 100'000, 2000},
    {"tremble-1%", 1'000'000, 50},
    {"teleport-0.1%", 100'000},
    {"teleport-1%", 100'000},
    {"teleport-1%", 1'000'000, 12},
    {"teleport-5%", 100'000},
    {"leap-1%", 100'000},
    {"leap-10%", 100'000},
    {"leap-100%", 100'000, 50},
    {"level", 20'000},
    {"level-unfiltered", 20'000},
    {"level-90%", 20'000},
    {"terrain", 20'000},
    {"plain", 12'000},
    {"plain", 102'000},
    {"plain", 2'002'000, 1000},
    {"replace-10%", 20'000},
    {"come-or-go-1%", 100'000, 40},
    {"come-1%", 100'000, 40},
    {"go-1%", 100'000, 40},
    {"thinned", 200'000, 40},
    {"cables", 100'000, 30},
    {"one-place", 1'000, 100},
};
constexpr std::uint32_t other_objects = 16'000;

std::vector<Row> rows(const Options& options) {
  std::vector<Row> result;
  if (options.objects == 0) result = special_rows;
  for (const MotionInfo& info : scenes::motions()) {
    const std::string name(info.name);
    if (std::ranges::none_of(result, [&](const Row& row) { return row.scene == name; })) {
      result.push_back({name, options.objects == 0 ? other_objects : options.objects});
    }
  }
  if (options.objects == 0) {
    result.push_back({"bullet", 3'500});
    result.push_back({"bullet-ghosts", 3'500});
  }
  const std::regex wanted(options.rows);
  std::erase_if(result, [&](const Row& row) { return !std::regex_search(row.name(), wanted); });
  if (options.frames > 0) {
    for (Row& row : result) row.frames = options.frames;
  }
  return result;
}

class Clock {
 public:
  explicit Clock(const Options& options)
      : id_(!options.wall && options.config.algorithm == "sweep-and-prune" && options.config.threads == 1
                ? CLOCK_PROCESS_CPUTIME_ID
                : CLOCK_MONOTONIC) {}

  /// The milliseconds of a call.
  template <class Function>
  [[nodiscard]] double time(const Function& function) const {
    const double start = now();
    function();
    return now() - start;
  }

 private:
  [[nodiscard]] double now() const {
    timespec time{};
    clock_gettime(id_, &time);
    return static_cast<double>(time.tv_sec) * 1e3 + static_cast<double>(time.tv_nsec) * 1e-6;
  }

  clockid_t id_;
};

double quantile(std::vector<double> times, double share) {
  const auto at = times.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(times.size() - 1));
  std::ranges::nth_element(times, at);
  return *at;
}
double median(const std::vector<double>& times) {
  return quantile(times, 0.5);
}

struct Result {
  std::vector<double> frames{};  // ms
  double again = 0;
  std::size_t objects = 0;  // at the end
};

/// The time of calls that may be so short that several are timed together.
template <class Function>
double time_calls(const Clock& clock, const Function& function) {
  constexpr double shortest = 2;
  std::size_t calls = 1;
  const auto several = [&] {
    for (std::size_t k = 0; k < calls; ++k) function();
  };
  while (clock.time(several) < shortest) calls *= 2;
  std::vector<double> times(5);
  for (double& time : times) time = clock.time(several) / static_cast<double>(calls);
  return median(times);
}

Result play(const Options& options, const Row& row) {
  const Clock clock(options);
  const auto info = std::ranges::find(scenes::motions(), row.scene, &MotionInfo::name);
  Motion motion(*info, row.objects);
  BroadPhase broad_phase(options.config);
  for (int frame = 0; frame < 2; ++frame) (void)motion.next().play(broad_phase);
  // Frames of few objects take less than the clock can tell.
  std::vector<MotionFrame> together(row.objects < 1000 ? 100 : 1);
  Result result;
  for (std::size_t frame = 0; frame < row.frames; frame += together.size()) {
    for (MotionFrame& one : together) one = motion.next();
    const double time = clock.time([&] {
      for (const MotionFrame& one : together) (void)one.play(broad_phase);
    });
    result.frames.push_back(time / static_cast<double>(together.size()));
  }
  const std::vector<Aabb> boxes = motion.present();
  result.objects = boxes.size();
  result.again = time_calls(clock, [&] { (void)overlapping_pairs(boxes, {}, options.config); });
  return result;
}

/// Static and dynamic bodies without gravity, and perhaps ghost objects.
class BulletWorld {
 public:
  BulletWorld(std::unique_ptr<btBroadphaseInterface> broadphase, bool ghosts)
      : broadphase_(std::move(broadphase)),
        world_(&dispatcher_, broadphase_.get(), &solver_, &configuration_) {
    constexpr int dynamic_bodies = 500;
    constexpr int static_bodies = 3'000;
    scenes::Random random(1);
    const auto anywhere = [&](float low, float high) {
      const Eigen::Vector3f at = random.vector(-30, 30);
      return btTransform(btQuaternion::getIdentity(), btVector3(at.x(), random.uniform(low, high), at.z()));
    };
    broadphase_->getOverlappingPairCache()->setInternalGhostPairCallback(&callback_);
    world_.setGravity(btVector3(0, 0, 0));
    for (int k = 0; k < dynamic_bodies + static_bodies; ++k) {
      const bool moves = k < dynamic_bodies;
      btCollisionShape& shape = moves ? cube_ : large_cube_;
      auto& body = bodies_.emplace_back(
          std::make_unique<btRigidBody>(moves ? 1 : 0, nullptr, &shape, btVector3(0.2F, 0.2F, 0.2F)));
      body->setWorldTransform(moves ? anywhere(3, 10) : anywhere(-4, 0));
      if (moves) {
        const Eigen::Vector3f velocity = random.vector(-6, 6);
        body->setLinearVelocity(btVector3(velocity.x(), 0, velocity.z()));
        body->setActivationState(DISABLE_DEACTIVATION);
      }
      world_.addRigidBody(body.get());
    }
    for (int k = 0; ghosts && k < 300; ++k) {
      auto& ghost = ghosts_.emplace_back(std::make_unique<btPairCachingGhostObject>());
      ghost->setCollisionShape(&large_cube_);
      ghost->setWorldTransform(anywhere(-2, 8));
      ghost->setCollisionFlags(btCollisionObject::CF_NO_CONTACT_RESPONSE);
      world_.addCollisionObject(ghost.get(), btBroadphaseProxy::SensorTrigger,
                                btBroadphaseProxy::DefaultFilter);
    }
  }
  ~BulletWorld() {
    for (auto& ghost : ghosts_) world_.removeCollisionObject(ghost.get());
    for (auto& body : bodies_) world_.removeRigidBody(body.get());
  }
  BulletWorld(const BulletWorld&) = delete;
  BulletWorld& operator=(const BulletWorld&) = delete;
  BulletWorld(BulletWorld&&) = delete;
  BulletWorld& operator=(BulletWorld&&) = delete;

  void step() { world_.stepSimulation(1.0F / 60, 0); }

 private:
  btBoxShape cube_{btVector3(0.4F, 0.4F, 0.4F)};
  btBoxShape large_cube_{btVector3(2.5F, 2.5F, 2.5F)};
  btGhostPairCallback callback_;
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btSequentialImpulseConstraintSolver solver_;
  std::unique_ptr<btBroadphaseInterface> broadphase_;
  std::vector<std::unique_ptr<btRigidBody>> bodies_;
  std::vector<std::unique_ptr<btPairCachingGhostObject>> ghosts_;
  btDiscreteDynamicsWorld world_;  // destroyed first, since it needs everything above it
};

Result play_bullet(const Options& options, const Row& row) {
  const Clock clock(options);
  const auto times = [&](std::unique_ptr<btBroadphaseInterface> broadphase) {
    BulletWorld world(std::move(broadphase), row.scene == "bullet-ghosts");
    for (int frame = 0; frame < 8; ++frame) world.step();
    std::vector<double> result(row.frames);
    for (double& time : result) time = clock.time([&] { world.step(); });
    return result;
  };
  return {.frames = times(std::make_unique<BulletBroadphase>(options.config)),
          .again = median(times(std::make_unique<btDbvtBroadphase>())),
          .objects = row.objects};
}

void print(const Row& row, const Result& result, std::optional<double> tremble) {
  const std::vector<double>& times = result.frames;
  const double middle = median(times);
  const auto quarter = static_cast<std::ptrdiff_t>((times.size() + 3) / 4);
  const double rise =
      median({times.end() - quarter, times.end()}) / median({times.begin(), times.begin() + quarter});
  std::printf("%-34s %8zu %10.5f %10.5f %10.5f %6.2f ", row.name().c_str(), result.objects, middle,
              quantile(times, 0.999), quantile(times, 1), rise);
  std::printf(tremble ? "%8.2f" : "       -", middle / tremble.value_or(1));
  std::printf(" %7.2f %10.5f\n", middle / result.again, result.again);
  std::fflush(stdout);
}

void run_rows(const Options& options) {
  std::printf("%-34s %8s %10s %10s %10s %6s %8s %7s %10s\n", "row", "objects", "median", "p99.9", "longest",
              "rise", "/tremble", "/again", "again");
  std::map<std::size_t, double> trembling;
  for (const Row& row : rows(options)) {
    const Result result = row.scene.starts_with("bullet") ? play_bullet(options, row) : play(options, row);
    if (row.scene == "tremble") trembling[row.objects] = median(result.frames);
    auto of_as_many = trembling.find(result.objects);
    if (of_as_many == trembling.end()) of_as_many = trembling.find(row.objects);
    print(row, result, of_as_many == trembling.end() ? std::nullopt : std::optional(of_as_many->second));
  }
}

/// The exponents with which the medians grow from 10,000 to 100,000 objects, and by how much they exceed that
/// of trembling.
void run_growth(const Options& options) {
  std::printf("%-34s %9s %9s %8s %6s\n", "scene", "10,000", "100,000", "exponent", "excess");
  std::optional<double> trembling;
  for (const MotionInfo& info : scenes::motions()) {
    const std::string scene(info.name);
    if (scene == "one-place") continue;  // its pairs grow so
    if (trembling && !std::regex_search(scene, std::regex(options.rows))) continue;
    const auto time = [&](std::uint32_t objects) {
      return median(play(options, {scene, objects, options.frames == 0 ? 60 : options.frames}).frames);
    };
    const double small = time(10'000);
    const double large = time(100'000);
    const double exponent = std::log10(large / small);
    if (!trembling) trembling = exponent;
    std::printf("%-34s %9.4f %9.4f %8.2f %6.2f\n", scene.c_str(), small, large, exponent,
                exponent - *trembling);
    std::fflush(stdout);
  }
}

std::string name_of(const ClustersInfo& info) {
  const std::uint32_t movers = std::min(info.movers, info.boxes) + info.convoy + info.commuters;
  return std::string(info.name) + "/" + std::to_string(std::min(movers, info.boxes));
}

/// Times of one call in double precision and one in single precision, and their ratio.
void print_both(double far, double near) {
  std::printf(" %10.5f %10.5f %7.2f", far, near, far / near);
}

void run_clusters(const Options& options) {
  const Clock clock(options);
  std::printf("%-24s %8s %10s %10s %7s %10s %10s %7s %10s %10s %7s\n", "scene/movers", "pairs", "float64",
              "float32", "ratio", "longest", "float32", "ratio", "one-shot", "float32", "ratio");
  for (const ClustersInfo& info : scenes::clusters()) {
    if (!std::regex_search(name_of(info), std::regex(options.rows))) continue;
    Clusters scene(info);
    BroadPhase64 far(options.config);
    BroadPhase near(options.config);
    const auto play = [&](std::size_t frames) {
      std::vector<Clusters::Frame> calls(frames);
      for (Clusters::Frame& frame : calls) frame = scene.next();
      return std::array{clock.time([&] {
                          for (const auto& frame : calls) (void)frame.far.play(far);
                        }),
                        clock.time([&] {
                          for (const auto& frame : calls) (void)frame.near.play(near);
                        })};
    };
    for (int frame = 0; frame < 20; ++frame) (void)play(1);
    // Frames of few objects take less than the clock can tell.
    const std::size_t together = 1 + 100 / (std::min(info.movers, info.boxes) + info.convoy + info.commuters);
    const std::size_t times =
        (options.frames == 0 ? 200 : options.frames) / std::min<std::size_t>(together, 10);
    std::array<double, 2> sum{}, longest{};
    for (std::size_t k = 0; k < times; ++k) {
      const auto taken = play(together);
      for (std::size_t of = 0; of < 2; ++of) {
        sum[of] += taken[of] / static_cast<double>(times * together);
        longest[of] = std::max(longest[of], taken[of] / static_cast<double>(together));
      }
    }
    std::vector<double> far_once(9), near_once(9);
    for (std::size_t k = 0; k < far_once.size(); ++k) {
      far_once[k] = clock.time([&] { (void)overlapping_pairs(scene.far(), {}, options.config); });
      near_once[k] = clock.time([&] { (void)overlapping_pairs(scene.near(), {}, options.config); });
    }
    std::printf("%-24s %8zu", name_of(info).c_str(), far.pairs().size());
    print_both(sum[0], sum[1]);
    print_both(longest[0], longest[1]);
    print_both(median(far_once), median(near_once));
    std::printf("\n");
    std::fflush(stdout);
  }
}

int run(int argc, char** argv) {
  Options options;
  CLI::App app("Times of frames in which objects move in different ways");
  app.add_option("--rows", options.rows, "A regular expression of rows, such as ^teleport")
      ->capture_default_str();
  app.add_option("--objects", options.objects, "In every scene; 0: as many as each row says");
  app.add_option("--frames", options.frames, "In every row; 0: as many as each row says");
  app.add_option("--algorithm", options.config.algorithm)->capture_default_str();
  app.add_option("--device", options.config.device, "As select_device() takes it");
  app.add_option("--threads", options.config.threads, "0: one per processor")->capture_default_str();
  app.add_flag("--wall", options.wall, "Measure wall time with one thread, too");
  app.add_flag("--growth", options.growth, "Print how times grow with the number of objects instead");
  app.add_flag("--double", options.in_double,
               "Print times in double precision, with clusters far apart, instead");
  app.add_flag("--list", options.list, "Print the names of the rows alone");
  CLI11_PARSE(app, argc, argv);
  if (options.list) {
    for (const Row& row : rows(options)) std::printf("%s\n", row.name().c_str());
  } else if (options.growth) {
    run_growth(options);
  } else if (options.in_double) {
    run_clusters(options);
  } else {
    run_rows(options);
  }
  return 0;
}

}  // namespace
}  // namespace broadcl::bench

int main(int argc, char** argv) try {
  return broadcl::bench::run(argc, argv);
} catch (const std::exception& error) {
  std::fprintf(stderr, "broadcl_motions: %s\n", error.what());
  return 1;
}
