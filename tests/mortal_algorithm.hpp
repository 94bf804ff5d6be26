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
  /// @param at_look Is called when somebody asks for contacts.
  static btCollisionAlgorithm* make(
      btDispatcher& dispatcher, std::function<void()> at_end, std::function<void()> at_look = [] {}) {
    void* place = dispatcher.allocateCollisionAlgorithm(sizeof(MortalAlgorithm));
    return new (place) MortalAlgorithm(std::move(at_end), std::move(at_look));
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
  void getAllContactManifolds(btManifoldArray& /*manifolds*/) override { at_look_(); }

 private:
  MortalAlgorithm(std::function<void()> at_end, std::function<void()> at_look)
      : at_end_(std::move(at_end)), at_look_(std::move(at_look)) {}

  std::function<void()> at_end_, at_look_;
};

}  // namespace broadcl::test
