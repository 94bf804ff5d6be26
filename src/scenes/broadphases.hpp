#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

class btBroadphaseInterface;

namespace broadcl::scenes {

/// A row of the table of broad phases that a World can run on: Bullet's own three, then every algorithm of
/// broadcl::algorithms() by its name.
struct BroadphaseInfo {
  std::string name;
  std::string summary;  ///< One line for people.
  bool exact;           ///< Its pairs are those of the exact boxes; Bullet's axis sweep and tree keep more.
  bool bullet;          ///< One of Bullet's own.
  bool on_device;       ///< Needs an OpenCL device.
};

/// bullet-bf (btSimpleBroadphase), bullet-sap (btAxisSweep3), bullet-bvh (btDbvtBroadphase), then BroadCL's.
[[nodiscard]] std::vector<BroadphaseInfo> broadphases();

/// The row of a name.
/// @throws broadcl::Error for an unknown one; it lists those there are.
[[nodiscard]] BroadphaseInfo find_broadphase(std::string_view name);

/// What a broad phase is made for.
struct BroadphaseConfig {
  std::string name;      ///< A name of broadphases().
  std::string device;    ///< As broadcl::select_device() takes it; only BroadCL's own use it.
  bool profile = false;  ///< As broadcl::BroadPhase::Config.
  std::size_t
      objects;  ///< For those with a fixed capacity: the number of proxies that will be made, walls included.
  float world_edge;  ///< For those with fixed bounds: edge of a cube around the origin that holds everything.
};

/// @throws broadcl::Error for an unknown name (it lists the known ones), and as broadcl::BroadPhase does.
[[nodiscard]] std::unique_ptr<btBroadphaseInterface> make_broadphase(const BroadphaseConfig& config);

}  // namespace broadcl::scenes
