#include "scenes/world.hpp"

#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <BulletCollision/CollisionDispatch/btCollisionDispatcher.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>
#include <BulletCollision/CollisionShapes/btBoxShape.h>
#include <BulletCollision/CollisionShapes/btSphereShape.h>
#include <BulletDynamics/ConstraintSolver/btSequentialImpulseConstraintSolver.h>
#include <BulletDynamics/Dynamics/btDiscreteDynamicsWorld.h>
#include <BulletDynamics/Dynamics/btRigidBody.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <vector>

#include "scenes/remove_all_pairs.hpp"

namespace broadcl::scenes {
namespace {

using TimePoint = std::chrono::steady_clock::time_point;

double seconds(TimePoint begin, TimePoint end) {
  return std::chrono::duration<double>(end - begin).count();
}

/// When something ran.
struct Interval {
  TimePoint begin;
  TimePoint end;
};

template <class Function>
Interval measure(Function&& function) {
  const TimePoint begin = std::chrono::steady_clock::now();
  function();
  return {begin, std::chrono::steady_clock::now()};
}

btVector3 to_bullet(const Eigen::Vector3f& v) {
  return {v.x(), v.y(), v.z()};
}

Eigen::Vector3f to_eigen(const btVector3& v) {
  return {v.x(), v.y(), v.z()};
}

class TimedWorld final : public btDiscreteDynamicsWorld {
 public:
  using btDiscreteDynamicsWorld::btDiscreteDynamicsWorld;

  void updateAabbs() override {
    update_ = measure([this] { btDiscreteDynamicsWorld::updateAabbs(); });
  }

  void computeOverlappingPairs() override {
    broad_phase_ = measure([this] { btDiscreteDynamicsWorld::computeOverlappingPairs(); });
  }

  [[nodiscard]] const Interval& update() const { return update_; }
  [[nodiscard]] const Interval& broad_phase() const { return broad_phase_; }

 private:
  Interval update_;
  Interval broad_phase_;
};

/// The parts of a world without objects.
struct EmptyWorld {
  btDefaultCollisionConfiguration config;
  btCollisionDispatcher dispatcher{&config};
  btDbvtBroadphase broadphase;
  btSequentialImpulseConstraintSolver solver;
};

/// Seconds per call: the minimum of several means.
template <class Function>
double least_seconds(Function&& function) {
  constexpr int batches = 20;
  constexpr int calls = 2000;
  double least = std::numeric_limits<double>::max();
  for (int batch = 0; batch < batches; ++batch) {
    const Interval all = measure([&] {
      for (int call = 0; call < calls; ++call) function();
    });
    least = std::min(least, seconds(all.begin, all.end) / calls);
  }
  return least;
}

/// Pools with room for the contacts of crowded scenes. Those that Bullet makes by default hold 4,096 pairs;
/// the others come from the heap.
btDefaultCollisionConstructionInfo with_pools_for(std::uint32_t objects) {
  btDefaultCollisionConstructionInfo info;
  const auto pairs =
      static_cast<int>(std::clamp<std::uint64_t>(std::uint64_t{16} * objects, 4096, 1U << 18U));
  info.m_defaultMaxPersistentManifoldPoolSize = pairs;
  info.m_defaultMaxCollisionAlgorithmPoolSize = pairs;
  return info;
}

/// Half a wall is thicker than the distance that an object falling across the container travels in a frame.
float wall_thickness(const Scenario& scenario) {
  return std::max(20.0F, scenario.container_edge() / 4);
}

}  // namespace

class World::Impl {
 public:
  Impl(const Scenario::Config& config, btBroadphaseInterface& broadphase)
      : scenario_(config),
        config_(with_pools_for(config.objects)),
        dispatcher_(&config_),
        world_(&dispatcher_, &broadphase, &solver_, &config_) {
    world_.setGravity(to_bullet(scenario_.gravity()));
    add_walls();
    for (const Scenario::Object& object : scenario_.objects()) add_object(object);
  }

  ~Impl() { remove_all_pairs(*world_.getPairCache(), &dispatcher_); }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  Impl(Impl&&) = delete;
  Impl& operator=(Impl&&) = delete;

  FrameTimes step() {
    if (scenario_.gravity_rotates()) {
      // The gravity of a world affects only bodies that are awake.
      for (std::size_t k = walls; k < bodies_.size(); ++k) bodies_[k]->activate();
      world_.setGravity(to_bullet(scenario_.gravity()));
    }
    for (const Scenario::Kick& kick : scenario_.kicks()) {
      btRigidBody& body = *bodies_[walls + kick.object];
      body.activate();
      body.setLinearVelocity(to_bullet(kick.velocity));
    }
    if (!scenario_.exchanges().empty()) wake_neighbours();
    Interval exchange{};
    const Interval frame = measure([&] {
      exchange = measure([this] { this->exchange(); });
      world_.stepSimulation(Scenario::frame_seconds, 0);
    });
    scenario_.advance();
    const Interval& update = world_.update();
    const Interval& broad_phase = world_.broad_phase();
    const double exchange_seconds = seconds(exchange.begin, exchange.end);
    return {.start = frame.begin,
            .update_start = seconds(frame.begin, update.begin) - exchange_seconds,
            .update = seconds(update.begin, update.end) + exchange_seconds,
            .broad_phase_start = seconds(frame.begin, broad_phase.begin),
            .broad_phase = seconds(broad_phase.begin, broad_phase.end),
            .total = seconds(frame.begin, frame.end)};
  }

  [[nodiscard]] const Scenario& scenario() const noexcept { return scenario_; }
  [[nodiscard]] btDiscreteDynamicsWorld& bullet() noexcept { return world_; }
  [[nodiscard]] const btDiscreteDynamicsWorld& bullet() const noexcept { return world_; }
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
    for (int k = 0; k < dispatcher_.getNumManifolds(); ++k) {
      const btPersistentManifold& manifold = *dispatcher_.getManifoldByIndexInternal(k);
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
      world_.removeRigidBody(&body);
      body.setCenterOfMassTransform(btTransform(btQuaternion::getIdentity(), to_bullet(exchange.position)));
      body.setInterpolationWorldTransform(body.getCenterOfMassTransform());
      body.setLinearVelocity(to_bullet(exchange.velocity));
      body.setAngularVelocity({0, 0, 0});
      body.clearForces();
      body.forceActivationState(ACTIVE_TAG);
      body.setDeactivationTime(0);
      world_.addRigidBody(&body);
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
    world_.addRigidBody(bodies_.back().get());
    return *bodies_.back();
  }

  // The world is destroyed first, since it needs everything above it.
  Scenario scenario_;
  btDefaultCollisionConfiguration config_;
  btCollisionDispatcher dispatcher_;
  btSequentialImpulseConstraintSolver solver_;
  std::vector<std::unique_ptr<btCollisionShape>> shapes_;
  std::map<float, btCollisionShape*> shape_by_edge_;
  std::vector<std::unique_ptr<btRigidBody>> bodies_;
  TimedWorld world_;
};

double measuring_overhead() {
  EmptyWorld parts;
  const auto stages_of = [&](btDiscreteDynamicsWorld& world) {
    world.updateAabbs();
    world.computeOverlappingPairs();
  };
  btDiscreteDynamicsWorld plain(&parts.dispatcher, &parts.broadphase, &parts.solver, &parts.config);
  TimedWorld timed(&parts.dispatcher, &parts.broadphase, &parts.solver, &parts.config);
  const double without = least_seconds([&] { stages_of(plain); });
  const double with = least_seconds([&] { (void)measure([&] { stages_of(timed); }); });
  return with - without;
}

World::World(const Scenario::Config& config, btBroadphaseInterface& broadphase)
    : impl_(std::make_unique<Impl>(config, broadphase)) {}

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
