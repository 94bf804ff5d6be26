#include "scenes/world.hpp"

#include <BulletCollision/CollisionDispatch/btCollisionDispatcherMt.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>
#include <BulletCollision/CollisionShapes/btBoxShape.h>
#include <BulletCollision/CollisionShapes/btSphereShape.h>
#include <BulletDynamics/ConstraintSolver/btSequentialImpulseConstraintSolverMt.h>
#include <BulletDynamics/Dynamics/btDiscreteDynamicsWorldMt.h>
#include <BulletDynamics/Dynamics/btRigidBody.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <map>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

#include "scenes/remove_all_pairs.hpp"
#include "scenes/task_scheduler.hpp"
#include "scenes/thread_time.hpp"

namespace broadcl::scenes {
namespace {

/// How long something ran, in seconds.
struct Duration {
  double wall;
  double cpu;  ///< Of this thread.
};

template <class Function>
Duration measure(Function&& function) {
  // What is measured with the wall clock does not contain the readings of the other one, which take longer.
  const double cpu = thread_seconds();
  const auto begin = std::chrono::steady_clock::now();
  function();
  const auto end = std::chrono::steady_clock::now();
  return {std::chrono::duration<double>(end - begin).count(), thread_seconds() - cpu};
}

btVector3 to_bullet(const Eigen::Vector3f& v) {
  return {v.x(), v.y(), v.z()};
}

Eigen::Vector3f to_eigen(const btVector3& v) {
  return {v.x(), v.y(), v.z()};
}

/// The stages of the last step.
struct Stages {
  Duration update;
  Duration broad_phase;
};

/// One of Bullet's worlds, measured.
template <class BulletWorld>
class TimedWorld final : public BulletWorld {
 public:
  /// @param arguments As BulletWorld takes them.
  template <class... Arguments>
  explicit TimedWorld(Stages& stages, Arguments*... arguments) : BulletWorld(arguments...), stages_(stages) {}

  void updateAabbs() override {
    stages_.update = measure([this] { BulletWorld::updateAabbs(); });
  }

  void computeOverlappingPairs() override {
    stages_.broad_phase = measure([this] { BulletWorld::computeOverlappingPairs(); });
  }

 private:
  Stages& stages_;
};

/// Pools large enough for the contacts of crowded scenes. Bullet's default pools hold 4,096 pairs; further
/// ones come from the heap.
btDefaultCollisionConstructionInfo with_pools_for(std::uint32_t objects) {
  btDefaultCollisionConstructionInfo info;
  const auto pairs =
      static_cast<int>(std::clamp<std::uint64_t>(std::uint64_t{16} * objects, 4096, 1U << 18U));
  info.m_defaultMaxPersistentManifoldPoolSize = pairs;
  info.m_defaultMaxCollisionAlgorithmPoolSize = pairs;
  return info;
}

/// The simulation: Bullet's classes for one thread, or those for several.
class Physics {
 public:
  Physics(const Scenario::Config& config, btBroadphaseInterface& broadphase, std::uint32_t threads)
      : config_(with_pools_for(config.objects)) {
    if (threads == 1) {
      dispatcher_ = std::make_unique<btCollisionDispatcher>(&config_);
      solver_ = std::make_unique<btSequentialImpulseConstraintSolver>();
      world_ = std::make_unique<TimedWorld<btDiscreteDynamicsWorld>>(stages_, dispatcher_.get(), &broadphase,
                                                                     solver_.get(), &config_);
      return;
    }
    scheduler_ = std::make_unique<ScopedTaskScheduler>(threads);
    dispatcher_ = std::make_unique<btCollisionDispatcherMt>(&config_);
    auto solvers = std::make_unique<btConstraintSolverPoolMt>(static_cast<int>(threads));
    large_island_solver_ = std::make_unique<btSequentialImpulseConstraintSolverMt>();
    world_ = std::make_unique<TimedWorld<btDiscreteDynamicsWorldMt>>(
        stages_, dispatcher_.get(), &broadphase, solvers.get(), large_island_solver_.get(), &config_);
    solver_ = std::move(solvers);
  }

  [[nodiscard]] btCollisionDispatcher& dispatcher() noexcept { return *dispatcher_; }
  [[nodiscard]] btDiscreteDynamicsWorld& world() noexcept { return *world_; }
  [[nodiscard]] const btDiscreteDynamicsWorld& world() const noexcept { return *world_; }
  [[nodiscard]] const Stages& stages() const noexcept { return stages_; }

 private:
  // The world is destroyed first, since it needs everything above it.
  btDefaultCollisionConfiguration config_;
  std::unique_ptr<ScopedTaskScheduler> scheduler_;  // null for one thread
  std::unique_ptr<btCollisionDispatcher> dispatcher_;
  std::unique_ptr<btConstraintSolver> solver_;
  std::unique_ptr<btConstraintSolver> large_island_solver_;  // null for one thread
  Stages stages_;
  std::unique_ptr<btDiscreteDynamicsWorld> world_;
};

/// Half a wall is thicker than the distance that an object falling across the container travels in a frame.
float wall_thickness(const Scenario& scenario) {
  return std::max(20.0F, scenario.container_edge() / 4);
}

}  // namespace

class World::Impl {
 public:
  Impl(const Scenario::Config& config, btBroadphaseInterface& broadphase, std::uint32_t threads)
      : scenario_(config), physics_(config, broadphase, threads) {
    bullet().setGravity(to_bullet(scenario_.gravity()));
    add_walls();
    for (const Scenario::Object& object : scenario_.objects()) add_object(object);
  }

  ~Impl() { remove_all_pairs(*bullet().getPairCache(), &physics_.dispatcher()); }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  Impl(Impl&&) = delete;
  Impl& operator=(Impl&&) = delete;

  FrameTimes step() {
    if (scenario_.gravity_rotates()) {
      // The gravity of a world affects only bodies that are awake.
      for (std::size_t k = walls; k < bodies_.size(); ++k) bodies_[k]->activate();
      bullet().setGravity(to_bullet(scenario_.gravity()));
    }
    for (const Scenario::Kick& kick : scenario_.kicks()) {
      btRigidBody& body = *bodies_[walls + kick.object];
      body.activate();
      body.setLinearVelocity(to_bullet(kick.velocity));
    }
    if (!scenario_.exchanges().empty()) wake_neighbours();
    Duration exchange{};
    const Duration frame = measure([&] {
      exchange = measure([this] { this->exchange(); });
      bullet().stepSimulation(Scenario::frame_seconds, 0);
    });
    scenario_.advance();
    const auto& [update, broad_phase] = physics_.stages();
    return {.update = update.wall + exchange.wall,
            .broad_phase = broad_phase.wall,
            .total = frame.wall,
            .cpu = {.update = update.cpu + exchange.cpu, .broad_phase = broad_phase.cpu, .total = frame.cpu}};
  }

  [[nodiscard]] const Scenario& scenario() const noexcept { return scenario_; }
  [[nodiscard]] btDiscreteDynamicsWorld& bullet() noexcept { return physics_.world(); }
  [[nodiscard]] const btDiscreteDynamicsWorld& bullet() const noexcept { return physics_.world(); }
  [[nodiscard]] const btRigidBody& object(std::size_t k) const { return *bodies_[walls + k]; }

 private:
  void add_walls() {
    const float inner = scenario_.container_edge() / 2;
    const float thickness = wall_thickness(scenario_);
    const Eigen::Vector3f outer = Eigen::Vector3f::Constant(inner + thickness);
    for (int axis = 0; axis < 3; ++axis) {
      Eigen::Vector3f half_extents = outer;
      half_extents[axis] = thickness / 2;
      btCollisionShape& shape = own(std::make_unique<btBoxShape>(to_bullet(half_extents)));
      const Eigen::Vector3f centre = Eigen::Vector3f::Unit(axis) * (inner + thickness / 2);
      for (const float side : {-1.0F, 1.0F}) add_body(shape, 0, centre * side);
    }
  }

  void add_object(const Scenario::Object& object) {
    const bool sphere = scenario_.config().spheres;
    const float volume =
        object.edge * object.edge * object.edge * (sphere ? std::numbers::pi_v<float> / 6 : 1);
    btRigidBody& body = add_body(shape_for(object.edge), volume, object.position);
    body.setLinearVelocity(to_bullet(object.velocity));
  }

  /// Objects that rest on one that leaves must fall, but Bullet would let them sleep.
  void wake_neighbours() {
    std::set<const btCollisionObject*> leaving;
    for (const Scenario::Exchange& exchange : scenario_.exchanges()) {
      leaving.insert(bodies_[walls + exchange.object].get());
    }
    btCollisionDispatcher& dispatcher = physics_.dispatcher();
    for (int k = 0; k < dispatcher.getNumManifolds(); ++k) {
      const btPersistentManifold& manifold = *dispatcher.getManifoldByIndexInternal(k);
      const std::array touching{manifold.getBody0(), manifold.getBody1()};
      if (manifold.getNumContacts() == 0 ||
          (!leaving.contains(touching[0]) && !leaving.contains(touching[1])))
        continue;
      for (const btCollisionObject* object : touching) object->activate();
    }
  }

  void exchange() {
    for (const Scenario::Exchange& exchange : scenario_.exchanges()) {
      btRigidBody& body = *bodies_[walls + exchange.object];
      bullet().removeRigidBody(&body);
      body.setCenterOfMassTransform(btTransform(btQuaternion::getIdentity(), to_bullet(exchange.position)));
      body.setInterpolationWorldTransform(body.getCenterOfMassTransform());
      body.setLinearVelocity(to_bullet(exchange.velocity));
      body.setAngularVelocity({0, 0, 0});
      body.clearForces();
      body.forceActivationState(ACTIVE_TAG);
      body.setDeactivationTime(0);
      bullet().addRigidBody(&body);
    }
  }

  btCollisionShape& shape_for(float edge) {
    const auto [entry, is_new] = shape_by_edge_.try_emplace(edge, nullptr);
    if (is_new) {
      const float half = edge / 2;
      if (scenario_.config().spheres) {
        entry->second = &own(std::make_unique<btSphereShape>(half));
      } else {
        entry->second = &own(std::make_unique<btBoxShape>(btVector3(half, half, half)));
      }
    }
    return *entry->second;
  }

  btCollisionShape& own(std::unique_ptr<btCollisionShape> shape) {
    shapes_.push_back(std::move(shape));
    return *shapes_.back();
  }

  /// Static if the mass is zero.
  btRigidBody& add_body(btCollisionShape& shape, float mass, const Eigen::Vector3f& position) {
    btVector3 inertia(0, 0, 0);
    if (mass > 0) shape.calculateLocalInertia(mass, inertia);
    btRigidBody::btRigidBodyConstructionInfo info(mass, nullptr, &shape, inertia);
    info.m_startWorldTransform.setOrigin(to_bullet(position));
    bodies_.push_back(std::make_unique<btRigidBody>(info));
    bullet().addRigidBody(bodies_.back().get());
    return *bodies_.back();
  }

  // The world is destroyed first, since it needs the shapes and the bodies.
  Scenario scenario_;
  std::vector<std::unique_ptr<btCollisionShape>> shapes_;
  std::map<float, btCollisionShape*> shape_by_edge_;
  std::vector<std::unique_ptr<btRigidBody>> bodies_;
  Physics physics_;
};

World::World(const Scenario::Config& config, btBroadphaseInterface& broadphase, std::uint32_t threads)
    : impl_(std::make_unique<Impl>(config, broadphase, threads)) {}

World::~World() = default;

float World::outer_edge(const Scenario& scenario) {
  return scenario.container_edge() + 2 * wall_thickness(scenario);
}

FrameTimes World::step() {
  return impl_->step();
}

const Scenario& World::scenario() const noexcept {
  return impl_->scenario();
}

btDiscreteDynamicsWorld& World::bullet() noexcept {
  return impl_->bullet();
}

std::size_t World::pair_count() const {
  const btBroadphaseInterface* broadphase = impl_->bullet().getBroadphase();
  return static_cast<std::size_t>(broadphase->getOverlappingPairCache()->getNumOverlappingPairs());
}

Eigen::Vector3f World::position(std::size_t object) const {
  return to_eigen(impl_->object(object).getCenterOfMassPosition());
}

Eigen::AlignedBox3f World::box(std::size_t object) const {
  btVector3 lower;
  btVector3 upper;
  impl_->bullet().getBroadphase()->getAabb(
      const_cast<btBroadphaseProxy*>(impl_->object(object).getBroadphaseHandle()), lower, upper);
  return {to_eigen(lower), to_eigen(upper)};
}

}  // namespace broadcl::scenes
