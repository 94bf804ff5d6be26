#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <broadcl/config.hpp>

class btBroadphaseInterface;

namespace broadcl::scenes {

/// A row of the table of broad phases that a World can use: Bullet's own three, then every algorithm of
/// broadcl::algorithms(), by name.
struct BroadphaseInfo {
  std::string name;
  std::string summary;  ///< One line for people.
  bool exact;           ///< Whether it has no extra pairs; Bullet's axis sweep and tree have some.
  bool bullet;          ///< One of Bullet's own.
  bool on_device;       ///< Needs an OpenCL device.
  bool culls = false;   ///< To be used with BulletBroadphase::set_shape_culling().
};

/// bullet-bf (btSimpleBroadphase), bullet-sap (btAxisSweep3), bullet-bvh (btDbvtBroadphase), then BroadCL's.
[[nodiscard]] std::vector<BroadphaseInfo> broadphases();

/// The row with a name. The name of one of BroadCL's broad phases may be followed by "+culling", which is
/// part of the row's name.
/// @throws broadcl::Error for an unknown name, listing the known ones.
[[nodiscard]] BroadphaseInfo find_broadphase(std::string_view name);

/// How to make a broad phase, and for what.
struct BroadphaseConfig {
  std::string name;             ///< As find_broadphase() takes it; culling is left to the caller.
  std::string device;           ///< As broadcl::select_device() takes it; ignored by Bullet's own.
  bool profile = false;         ///< As broadcl::BroadPhase::Config.
  CompileHandler on_compile{};  ///< Likewise.
  std::size_t objects;  ///< Number of proxies including walls; needed by broad phases with a fixed capacity.
  float world_edge;  ///< Edge of a cube around the origin that holds everything; for those with fixed bounds.
};

/// @throws broadcl::Error for an unknown name, listing the known ones, and as broadcl::BroadPhase does.
[[nodiscard]] std::unique_ptr<btBroadphaseInterface> make_broadphase(const BroadphaseConfig& config);

}  // namespace broadcl::scenes
