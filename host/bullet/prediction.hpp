#pragma once

#include <BulletCollision/CollisionDispatch/btCollisionObject.h>
#include <BulletDynamics/Dynamics/btRigidBody.h>

#include <vector>

class btCollisionWorld;

namespace broadcl {

/// As long as it lives, the rigid bodies of a world are as the next step will have them when it computes
/// their boxes: damped, and with the transform predicted that btCollisionWorld merges into a box. Its end
/// puts everything back, activation states included, for updateAabbs() may change those.
class Prediction {
 public:
  /// @param time_step Of the next step, in seconds; 0 predicts nothing.
  Prediction(btCollisionWorld& world, btScalar time_step);
  ~Prediction();
  Prediction(const Prediction&) = delete;
  Prediction& operator=(const Prediction&) = delete;
  Prediction(Prediction&&) = delete;
  Prediction& operator=(Prediction&&) = delete;

 private:
  struct Motion {
    btRigidBody* body;
    btVector3 linear_velocity;
    btVector3 angular_velocity;
    btTransform interpolation;
  };
  struct Activation {
    btCollisionObject* object;
    int state;
  };

  void predict(btRigidBody& body, btScalar time_step);

  std::vector<Motion> motions_;
  std::vector<Activation> activations_;
};

}  // namespace broadcl
