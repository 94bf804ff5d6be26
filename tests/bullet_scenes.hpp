#pragma once

#include <functional>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include <BulletDynamics/Dynamics/btDiscreteDynamicsWorld.h>

namespace broadcl::test {

/// A Bullet world and what happens in it, frame by frame. The calls to its broad phase depend only on the
/// pairs that it reports.
class BulletScene {
 public:
  BulletScene() = default;
  virtual ~BulletScene() = default;
  BulletScene(const BulletScene&) = delete;
  BulletScene& operator=(const BulletScene&) = delete;
  BulletScene(BulletScene&&) = delete;
  BulletScene& operator=(BulletScene&&) = delete;

  virtual void step() = 0;
  virtual btDiscreteDynamicsWorld& bullet() = 0;
};

/// A row of the table of scenes.
struct BulletSceneInfo {
  std::string name;
  int frames;  ///< Enough for everything that the scene is meant to show.
  /// The broad phase is not owned and must outlive the scene.
  std::function<std::unique_ptr<BulletScene>(btBroadphaseInterface& broadphase)> make;
};

inline std::ostream& operator<<(std::ostream& out, const BulletSceneInfo& info) {
  return out << info.name;
}

/// The paper's scenarios, then soft bodies, ghosts, a thousand stacked boxes and a hundred ragdolls.
[[nodiscard]] std::vector<BulletSceneInfo> bullet_scenes();

}  // namespace broadcl::test
