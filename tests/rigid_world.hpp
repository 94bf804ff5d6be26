#pragma once

#include <btBulletDynamicsCommon.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "bullet_rig.hpp"
#include "scenes/verify.hpp"

namespace broadcl::test {

constexpr btScalar time_step = btScalar(1) / 60;

/// The position of cell k in a grid with edges of 1, by rows along x, layers of rows along y, then z.
inline btVector3 grid_cell(int k, int columns, int rows) {
  const int row = k / columns;
  const int layer = row / rows;
  return {btScalar(k % columns), btScalar(row % rows), btScalar(layer)};
}

/// Rigid bodies in a world of any kind; the destructor removes those that are still in it.
class RigidBodies {
 public:
  /// @param world Not owned, must outlive this object.
  explicit RigidBodies(btDiscreteDynamicsWorld& world) : world_(world) {}
  ~RigidBodies() {
    while (!bodies_.empty()) remove(*bodies_.back());
  }
  RigidBodies(const RigidBodies&) = delete;
  RigidBodies& operator=(const RigidBodies&) = delete;
  RigidBodies(RigidBodies&&) = delete;
  RigidBodies& operator=(RigidBodies&&) = delete;

  /// @param shape Not owned, must outlive this object.
  /// @param mass 0 for a static body.
  btRigidBody& add(btCollisionShape& shape, btScalar mass, const btVector3& position) {
    btVector3 inertia(0, 0, 0);
    if (mass > 0) shape.calculateLocalInertia(mass, inertia);
    btRigidBody::btRigidBodyConstructionInfo info(mass, nullptr, &shape, inertia);
    info.m_startWorldTransform.setOrigin(position);
    bodies_.push_back(std::make_unique<btRigidBody>(info));
    world_.addRigidBody(bodies_.back().get());
    return *bodies_.back();
  }
  /// With edges of 1 and a mass of 1.
  btRigidBody& add_cube(const btVector3& position) { return add(cube_, 1, position); }
  /// The plane y = 0.
  btRigidBody& add_floor() { return add(plane_, 0, {0, 0, 0}); }
  /// Removes a body from the world and destroys it.
  void remove(btRigidBody& body) {
    world_.removeRigidBody(&body);
    std::erase_if(bodies_, [&](const auto& owned) { return owned.get() == &body; });
  }

  [[nodiscard]] const std::vector<std::unique_ptr<btRigidBody>>& all() const { return bodies_; }

 private:
  btDiscreteDynamicsWorld& world_;
  btBoxShape cube_{{0.5F, 0.5F, 0.5F}};
  btStaticPlaneShape plane_{{0, 1, 0}, 0};
  std::vector<std::unique_ptr<btRigidBody>> bodies_;
};

/// A world of rigid bodies as most users make it.
class RigidWorld {
 public:
  /// @param broadphase Not owned, must outlive this object.
  explicit RigidWorld(btBroadphaseInterface& broadphase)
      : world(&dispatcher_, &broadphase, &solver_, &configuration_) {}

  void step(int times = 1) {
    for (int k = 0; k < times; ++k) world.stepSimulation(time_step, 0);
  }

 private:
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btSequentialImpulseConstraintSolver solver_;

 public:
  btDiscreteDynamicsWorld world;
  RigidBodies bodies{world};
};

/// After a step the cache must have all pairs that overlap and, if the broad phase promises this, no others.
inline void expect_right_pairs(btCollisionWorld& world, const Kind& kind) {
  const scenes::Difference difference = scenes::verify(world);
  EXPECT_EQ(difference.missing, 0U);
  if (kind.name == "BroadCL") {
    EXPECT_EQ(difference.extra, 0U);
  }
}

inline btScalar height(const btRigidBody& body) {
  return body.getWorldTransform().getOrigin().y();
}

/// Positions and velocities of the first bodies, bit for bit.
inline std::vector<btScalar> state(const RigidWorld& world, std::size_t count) {
  std::vector<btScalar> result;
  for (std::size_t k = 0; k < count; ++k) {
    const btRigidBody& body = *world.bodies.all()[k];
    for (const btVector3& v : {body.getWorldTransform().getOrigin(), body.getLinearVelocity()}) {
      result.insert(result.end(), v.m_floats, v.m_floats + 3);
    }
  }
  return result;
}

}  // namespace broadcl::test
