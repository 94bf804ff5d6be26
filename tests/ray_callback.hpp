#pragma once

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>

namespace broadcl::test {

/// A ray as btCollisionWorld prepares it.
struct RayCallback : btBroadphaseRayCallback {
  RayCallback(const btVector3& from, const btVector3& to) {
    btVector3 direction = to - from;
    if (!direction.fuzzyZero()) direction.normalize();
    for (int axis = 0; axis < 3; ++axis) {
      m_rayDirectionInverse[axis] =
          direction[axis] == 0 ? btScalar(BT_LARGE_FLOAT) : btScalar(1) / direction[axis];
      m_signs[axis] = m_rayDirectionInverse[axis] < 0 ? 1 : 0;
    }
    m_lambda_max = direction.dot(to - from);
  }
};

}  // namespace broadcl::test
