#include "bullet/prediction.hpp"

#include <BulletCollision/CollisionDispatch/btCollisionWorld.h>

namespace broadcl {

Prediction::Prediction(btCollisionWorld& world, btScalar time_step) {
  const btCollisionObjectArray& objects = world.getCollisionObjectArray();
  activations_.reserve(static_cast<std::size_t>(objects.size()));
  motions_.reserve(static_cast<std::size_t>(objects.size()));
  for (int k = 0; k < objects.size(); ++k) {
    activations_.push_back({objects[k], objects[k]->getActivationState()});
    btRigidBody* body = btRigidBody::upcast(objects[k]);
    if (time_step != 0 && body != nullptr && !body->isStaticOrKinematicObject()) predict(*body, time_step);
  }
}

Prediction::~Prediction() {
  for (const Activation& activation : activations_) {
    if (activation.object->getActivationState() != activation.state) {
      activation.object->forceActivationState(activation.state);
    }
  }
  for (const Motion& motion : motions_) {
    motion.body->setLinearVelocity(motion.linear_velocity);
    motion.body->setAngularVelocity(motion.angular_velocity);
    motion.body->getInterpolationWorldTransform() = motion.interpolation;
  }
}

// What btDiscreteDynamicsWorld::predictUnconstraintMotion() does, which is not public.
void Prediction::predict(btRigidBody& body, btScalar time_step) {
  motions_.push_back({.body = &body,
                      .linear_velocity = body.getLinearVelocity(),
                      .angular_velocity = body.getAngularVelocity(),
                      .interpolation = body.getInterpolationWorldTransform()});
  body.applyDamping(time_step);
  body.predictIntegratedTransform(time_step, body.getInterpolationWorldTransform());
}

}  // namespace broadcl
