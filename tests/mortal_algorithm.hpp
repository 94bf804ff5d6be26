#pragma once

#include <BulletCollision/BroadphaseCollision/btCollisionAlgorithm.h>
#include <BulletCollision/BroadphaseCollision/btDispatcher.h>

#include <functional>
#include <new>
#include <utility>

namespace broadcl::test {

/// Takes the place of Bullet's algorithm in a pair, and reports its destruction.
class MortalAlgorithm final : public btCollisionAlgorithm {
 public:
  /// In the dispatcher's memory, as Bullet makes them; it is destroyed with its pair.
  static btCollisionAlgorithm* make(btDispatcher& dispatcher, std::function<void()> at_end) {
    void* place = dispatcher.allocateCollisionAlgorithm(sizeof(MortalAlgorithm));
    return new (place) MortalAlgorithm(std::move(at_end));
  }
  ~MortalAlgorithm() override { at_end_(); }
  MortalAlgorithm(const MortalAlgorithm&) = delete;
  MortalAlgorithm& operator=(const MortalAlgorithm&) = delete;
  MortalAlgorithm(MortalAlgorithm&&) = delete;
  MortalAlgorithm& operator=(MortalAlgorithm&&) = delete;

  void processCollision(const btCollisionObjectWrapper* /*a*/, const btCollisionObjectWrapper* /*b*/,
                        const btDispatcherInfo& /*info*/, btManifoldResult* /*result*/) override {}
  btScalar calculateTimeOfImpact(btCollisionObject* /*a*/, btCollisionObject* /*b*/,
                                 const btDispatcherInfo& /*info*/, btManifoldResult* /*result*/) override {
    return 1;
  }
  void getAllContactManifolds(btManifoldArray& /*manifolds*/) override {}

 private:
  explicit MortalAlgorithm(std::function<void()> at_end) : at_end_(std::move(at_end)) {}

  std::function<void()> at_end_;
};

}  // namespace broadcl::test
