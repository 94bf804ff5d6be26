#include "bullet_scenes.hpp"

#include "scenes/world.hpp"  // before Bullet's soft bodies, which have a global named `seed`

#include <BulletCollision/CollisionDispatch/btGhostObject.h>
#include <BulletSoftBody/btSoftBodyHelpers.h>
#include <BulletSoftBody/btSoftBodyRigidBodyCollisionConfiguration.h>
#include <BulletSoftBody/btSoftRigidDynamicsWorld.h>
#include <btBulletDynamicsCommon.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

namespace broadcl::test {
namespace {

class ScenarioScene final : public BulletScene {
 public:
  ScenarioScene(const scenes::Scenario::Config& config, btBroadphaseInterface& broadphase)
      : world_(config, broadphase) {}

  void step() override { world_.step(); }
  btDiscreteDynamicsWorld& bullet() override { return world_.bullet(); }

 private:
  scenes::World world_;
};

/// A world of one of Bullet's classes, and everything that must outlive it.
template <class World, class Configuration>
class SceneIn : public BulletScene {
 public:
  explicit SceneIn(btBroadphaseInterface& broadphase)
      : world_(&dispatcher_, &broadphase, &solver_, &configuration_) {
    world_.getPairCache()->setInternalGhostPairCallback(&ghost_callback_);
  }

  void step() override {
    before_step(frame_++);
    world_.stepSimulation(btScalar(1) / 60, 0);
  }
  btDiscreteDynamicsWorld& bullet() override { return world_; }

 protected:
  virtual void before_step(int /*frame*/) {}

  World& world() { return world_; }

  template <class Shape>
  Shape& keep(std::unique_ptr<Shape> shape) {
    Shape& result = *shape;
    shapes_.push_back(std::move(shape));
    return result;
  }

  template <class Object>
  Object& keep_object(std::unique_ptr<Object> object) {
    Object& result = *object;
    objects_.push_back(std::move(object));
    return result;
  }

  /// Static if the mass is zero.
  btRigidBody& add_body(btCollisionShape& shape, btScalar mass, const btTransform& transform) {
    btVector3 inertia(0, 0, 0);
    if (mass > 0) shape.calculateLocalInertia(mass, inertia);
    btRigidBody::btRigidBodyConstructionInfo info(mass, nullptr, &shape, inertia);
    info.m_startWorldTransform = transform;
    btRigidBody& body = keep_object(std::make_unique<btRigidBody>(info));
    world_.addRigidBody(&body);
    return body;
  }
  btRigidBody& add_body(btCollisionShape& shape, btScalar mass, const btVector3& origin) {
    return add_body(shape, mass, btTransform(btQuaternion::getIdentity(), origin));
  }

  /// Everything above y = 0 falls on it, and its box overlaps all others.
  void add_floor() {
    add_body(keep(std::make_unique<btStaticPlaneShape>(btVector3(0, 1, 0), btScalar(0))), 0,
             btVector3(0, 0, 0));
  }

  void add_constraint(std::unique_ptr<btTypedConstraint> constraint) {
    world_.addConstraint(constraint.get(), /*disableCollisionsBetweenLinkedBodies=*/true);
    constraints_.push_back(std::move(constraint));
  }

 private:
  Configuration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btSequentialImpulseConstraintSolver solver_;
  btGhostPairCallback ghost_callback_;
  std::vector<std::unique_ptr<btCollisionShape>> shapes_;
  std::vector<std::unique_ptr<btCollisionObject>> objects_;
  std::vector<std::unique_ptr<btTypedConstraint>> constraints_;
  World world_;
  int frame_ = 0;
};

/// Cell k of a grid whose layers have n x n cells.
btVector3 cell(int k, int n) {
  const int y = k / (n * n);
  const int z = k / n % n;
  return {btScalar(k % n), btScalar(y), btScalar(z)};
}

using RigidScene = SceneIn<btDiscreteDynamicsWorld, btDefaultCollisionConfiguration>;
using SoftScene = SceneIn<btSoftRigidDynamicsWorld, btSoftBodyRigidBodyCollisionConfiguration>;

/// A cloth that hangs by its corners, boxes that fall on it, and a soft ball that follows them and bounces
/// off. Then the cloth comes loose.
class SoftBodies final : public SoftScene {
 public:
  explicit SoftBodies(btBroadphaseInterface& broadphase) : SoftScene(broadphase) {
    add_floor();
    btCollisionShape& box = keep(std::make_unique<btBoxShape>(btVector3(0.4F, 0.3F, 0.3F)));
    for (int k = 0; k < 75; ++k) add_body(box, 0.2F, btVector3(-2, 3.5F, -2) + cell(k, 5));
    constexpr int all_corners = 1 + 2 + 4 + 8;
    cloth_ = &add(btSoftBodyHelpers::CreatePatch(world().getWorldInfo(), {-4, 3, -4}, {4, 3, -4}, {-4, 3, 4},
                                                 {4, 3, 4}, 17, 17, all_corners, true),
                  4);
    btSoftBody& ball =
        add(btSoftBodyHelpers::CreateEllipsoid(world().getWorldInfo(), {0, 8, 0}, {1, 1, 1}, 96), 5);
    ball.m_cfg.kPR = 500;
    ball.m_cfg.collisions |= btSoftBody::fCollision::VF_SS;
    ball.setVelocity({0, -8, 0});
  }
  SoftBodies(const SoftBodies&) = delete;
  SoftBodies& operator=(const SoftBodies&) = delete;
  SoftBodies(SoftBodies&&) = delete;
  SoftBodies& operator=(SoftBodies&&) = delete;
  /// A pair of a soft body refers to a part of the world that Bullet destroys before the pairs.
  ~SoftBodies() override {
    btSoftBodyArray& bodies = world().getSoftBodyArray();
    while (bodies.size() > 0) world().removeSoftBody(bodies[0]);
  }

 private:
  void before_step(int frame) override {
    if (frame != 50) return;
    for (int k = 0; k < cloth_->m_nodes.size(); ++k) cloth_->setMass(k, 0.01F);
  }

  btSoftBody& add(btSoftBody* body, btScalar mass) {
    keep_object(std::unique_ptr<btSoftBody>(body));
    body->setTotalMass(mass);
    world().addSoftBody(body);
    return *body;
  }

  btSoftBody* cloth_;
};

/// Ghosts of both classes that move back and forth in a rain of boxes, each in its own way. The boxes that
/// fell first start again at the top, and one ghost leaves the world for a while.
class Ghosts final : public RigidScene {
 public:
  explicit Ghosts(btBroadphaseInterface& broadphase) : RigidScene(broadphase) {
    add_floor();
    btCollisionShape& box = keep(std::make_unique<btBoxShape>(btVector3(0.3F, 0.3F, 0.3F)));
    for (int k = 0; k < 300; ++k) boxes_.push_back(&add_body(box, 1, start(k)));
    btCollisionShape& probe = keep(std::make_unique<btSphereShape>(btScalar(1.5)));
    for (int k = 0; k < 4; ++k) {
      add_ghost(keep_object(std::make_unique<btGhostObject>()), probe);
      add_ghost(keep_object(std::make_unique<btPairCachingGhostObject>()), probe);
    }
  }

 private:
  static btVector3 start(int k) { return btVector3(-5, 1, -5) + cell(k, 10) * btVector3(1, 2, 1); }

  /// Every third sees boxes only, not the floor and not the other ghosts.
  void add_ghost(btGhostObject& ghost, btCollisionShape& shape) {
    ghost.setCollisionShape(&shape);
    ghost.setCollisionFlags(ghost.getCollisionFlags() | btCollisionObject::CF_NO_CONTACT_RESPONSE);
    if (ghosts_.size() % 3 == 0) {
      world().addCollisionObject(&ghost, btBroadphaseProxy::SensorTrigger, btBroadphaseProxy::DefaultFilter);
    } else {
      world().addCollisionObject(&ghost);
    }
    ghosts_.push_back(&ghost);
  }

  void before_step(int frame) override {
    for (std::size_t k = 0; k < ghosts_.size(); ++k) {
      const btScalar way = btSin(btScalar(frame) / 8 + btScalar(k));
      ghosts_[k]->setWorldTransform(
          btTransform(btQuaternion::getIdentity(), {5 * way, 1, btScalar(k) - 4 + way}));
    }
    const int first = frame * 3 % static_cast<int>(boxes_.size());
    for (int k = first; k < first + 3; ++k) {
      btRigidBody& box = *boxes_[static_cast<std::size_t>(k)];
      world().removeRigidBody(&box);
      box.setCenterOfMassTransform(btTransform(btQuaternion::getIdentity(), start(k) + btVector3(0, 6, 0)));
      world().addRigidBody(&box);
    }
    if (frame == 30) world().removeCollisionObject(ghosts_[1]);
    if (frame == 60) world().addCollisionObject(ghosts_[1]);
  }

  std::vector<btRigidBody*> boxes_;
  std::vector<btGhostObject*> ghosts_;
};

/// A wall of bricks in a running bond, at rest, until a heavy ball breaks through.
class Stack final : public RigidScene {
 public:
  explicit Stack(btBroadphaseInterface& broadphase) : RigidScene(broadphase) {
    add_floor();
    const btVector3 half(0.5F, 0.25F, 0.25F);
    btCollisionShape& brick = keep(std::make_unique<btBoxShape>(half));
    constexpr int columns = 40;
    constexpr int rows = 25;
    for (int k = 0; k < columns * rows; ++k) {
      const int row = k / columns;
      const btScalar x = btScalar(k % columns) + (row % 2 == 0 ? half.x() : 0);
      add_body(brick, 1, btVector3(x, half.y() * btScalar(1 + 2 * row), 0));
    }
  }

 private:
  void before_step(int frame) override {
    if (frame != 20) return;
    btCollisionShape& sphere = keep(std::make_unique<btSphereShape>(btScalar(2)));
    add_body(sphere, 200, btVector3(20, 5, 6)).setLinearVelocity({3, 0, -30});
  }
};

/// A hundred of the ragdolls in Bullet's demo, eleven capsules each, that fall on one another.
class Ragdolls final : public RigidScene {
 public:
  explicit Ragdolls(btBroadphaseInterface& broadphase) : RigidScene(broadphase) {
    add_floor();
    for (const Part& part : parts) {
      shapes_.push_back(&keep(std::make_unique<btCapsuleShape>(part.radius, part.length)));
    }
    for (int k = 0; k < 100; ++k) {
      const btVector3 place = cell(k, 5) * btVector3(1, 2, 0.5F);
      add(btTransform(btQuaternion(btVector3(0, 1, 0), btScalar(k)), place), {0, 0, btScalar(k % 7) - 3});
    }
  }

 private:
  struct Part {
    btScalar radius;
    btScalar length;
    std::array<btScalar, 3> origin;
    bool lies;  // along x; otherwise it stands
  };
  enum Index : std::size_t {
    pelvis,
    spine,
    head,
    left_thigh,
    left_shin,
    right_thigh,
    right_shin,
    left_arm,
    left_forearm,
    right_arm,
    right_forearm
  };
  struct Joint {
    Index parent;
    Index child;
    std::array<btScalar, 3> pivot;
    std::array<btScalar, 3> axis;  // of a hinge, or of the twist of a cone
    bool is_hinge;
  };

  static constexpr std::array<Part, 11> parts{{
      {0.15F, 0.20F, {0, 1, 0}, false},
      {0.15F, 0.28F, {0, 1.2F, 0}, false},
      {0.10F, 0.05F, {0, 1.6F, 0}, false},
      {0.07F, 0.45F, {-0.18F, 0.65F, 0}, false},
      {0.05F, 0.37F, {-0.18F, 0.2F, 0}, false},
      {0.07F, 0.45F, {0.18F, 0.65F, 0}, false},
      {0.05F, 0.37F, {0.18F, 0.2F, 0}, false},
      {0.05F, 0.33F, {-0.35F, 1.45F, 0}, true},
      {0.04F, 0.25F, {-0.7F, 1.45F, 0}, true},
      {0.05F, 0.33F, {0.35F, 1.45F, 0}, true},
      {0.04F, 0.25F, {0.7F, 1.45F, 0}, true},
  }};
  static constexpr std::array<Joint, 10> joints{{
      {pelvis, spine, {0, 1.1F, 0}, {1, 0, 0}, true},
      {spine, head, {0, 1.48F, 0}, {0, 1, 0}, false},
      {pelvis, left_thigh, {-0.18F, 0.89F, 0}, {0, -1, 0}, false},
      {left_thigh, left_shin, {-0.18F, 0.4F, 0}, {1, 0, 0}, true},
      {pelvis, right_thigh, {0.18F, 0.89F, 0}, {0, -1, 0}, false},
      {right_thigh, right_shin, {0.18F, 0.4F, 0}, {1, 0, 0}, true},
      {spine, left_arm, {-0.18F, 1.42F, 0}, {-1, 0, 0}, false},
      {left_arm, left_forearm, {-0.54F, 1.45F, 0}, {0, 1, 0}, true},
      {spine, right_arm, {0.18F, 1.42F, 0}, {1, 0, 0}, false},
      {right_arm, right_forearm, {0.54F, 1.45F, 0}, {0, 1, 0}, true},
  }};

  static btVector3 vector(const std::array<btScalar, 3>& v) { return {v[0], v[1], v[2]}; }

  void add(const btTransform& place, const btVector3& velocity) {
    std::vector<btRigidBody*> bodies;
    for (std::size_t k = 0; k < parts.size(); ++k) {
      const btQuaternion rotation(btVector3(0, 0, 1), parts[k].lies ? SIMD_HALF_PI : 0);
      bodies.push_back(&add_body(*shapes_[k], 1, place * btTransform(rotation, vector(parts[k].origin))));
      bodies.back()->setLinearVelocity(velocity);
      bodies.back()->setDamping(0.05F, 0.85F);
    }
    for (const Joint& joint : joints) {
      btRigidBody& a = *bodies[joint.parent];
      btRigidBody& b = *bodies[joint.child];
      const btVector3 own_axis = joint.is_hinge ? btVector3(0, 0, 1) : btVector3(1, 0, 0);
      const btTransform pivot =
          place * btTransform(shortestArcQuat(own_axis, vector(joint.axis)), vector(joint.pivot));
      const btTransform in_a = a.getWorldTransform().inverse() * pivot;
      const btTransform in_b = b.getWorldTransform().inverse() * pivot;
      if (joint.is_hinge) {
        auto hinge = std::make_unique<btHingeConstraint>(a, b, in_a, in_b);
        hinge->setLimit(-0.2F, SIMD_HALF_PI);
        add_constraint(std::move(hinge));
      } else {
        auto cone = std::make_unique<btConeTwistConstraint>(a, b, in_a, in_b);
        cone->setLimit(SIMD_PI / 4, SIMD_PI / 4, SIMD_PI / 8);
        add_constraint(std::move(cone));
      }
    }
  }

  std::vector<btCollisionShape*> shapes_;
};

template <class Scene>
BulletSceneInfo row(const char* name, int frames) {
  return {.name = name, .frames = frames, .make = [](btBroadphaseInterface& broadphase) {
            return std::make_unique<Scene>(broadphase);
          }};
}

}  // namespace

std::vector<BulletSceneInfo> bullet_scenes() {
  std::vector<BulletSceneInfo> rows;
  for (const scenes::ScenarioInfo& info : scenes::Scenario::list()) {
    const scenes::Scenario::Config config{.name = std::string(info.name), .objects = 500};
    std::string name = config.name;
    std::erase(name, '-');
    rows.push_back(
        {.name = std::move(name), .frames = 64, .make = [config](btBroadphaseInterface& broadphase) {
           return std::make_unique<ScenarioScene>(config, broadphase);
         }});
  }
  rows.push_back(row<SoftBodies>("SoftBodies", 150));
  rows.push_back(row<Ghosts>("Ghosts", 100));
  rows.push_back(row<Stack>("ThousandBoxes", 80));
  rows.push_back(row<Ragdolls>("HundredRagdolls", 80));
  return rows;
}

}  // namespace broadcl::test
