#include "scenes/broadphases.hpp"

#include <BulletCollision/BroadphaseCollision/btAxisSweep3.h>
#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <BulletCollision/BroadphaseCollision/btSimpleBroadphase.h>

#include <algorithm>
#include <array>
#include <broadcl/algorithms.hpp>
#include <broadcl/bullet.hpp>

namespace broadcl::scenes {
namespace {

using Maker = std::unique_ptr<btBroadphaseInterface> (*)(const BroadphaseConfig&);

struct BulletRow {
  std::string_view name;
  std::string_view summary;
  bool exact;
  Maker make;
};

std::unique_ptr<btBroadphaseInterface> make_simple(const BroadphaseConfig& config) {
  return std::make_unique<btSimpleBroadphase>(static_cast<int>(config.objects));
}

std::unique_ptr<btBroadphaseInterface> make_axis_sweep(const BroadphaseConfig& config) {
  constexpr std::size_t most_with_16_bits = 16384;
  const btScalar half = config.world_edge / 2;
  const btVector3 upper(half, half, half);
  if (config.objects <= most_with_16_bits) {
    return std::make_unique<btAxisSweep3>(-upper, upper, static_cast<unsigned short>(config.objects));
  }
  return std::make_unique<bt32BitAxisSweep3>(-upper, upper, static_cast<unsigned>(config.objects));
}

std::unique_ptr<btBroadphaseInterface> make_tree(const BroadphaseConfig& /*config*/) {
  return std::make_unique<btDbvtBroadphase>();
}

constexpr std::array bullet_rows{
    BulletRow{.name = "bullet-bf",
              .summary = "btSimpleBroadphase: brute force",
              .exact = true,
              .make = make_simple},
    BulletRow{.name = "bullet-sap",
              .summary = "btAxisSweep3: sweep and prune (bt32BitAxisSweep3 above 16,384 objects)",
              .exact = false,
              .make = make_axis_sweep},
    BulletRow{.name = "bullet-bvh",
              .summary = "btDbvtBroadphase: dynamic bounding volume trees",
              .exact = false,
              .make = make_tree},
};

constexpr std::string_view culling = "+culling";

std::string_view without_culling(std::string_view name) {
  if (name.ends_with(culling)) name.remove_suffix(culling.size());
  return name;
}

}  // namespace

std::vector<BroadphaseInfo> broadphases() {
  std::vector<BroadphaseInfo> rows;
  rows.reserve(bullet_rows.size() + algorithms().size());
  for (const BulletRow& row : bullet_rows) {
    rows.push_back({.name = std::string(row.name),
                    .summary = std::string(row.summary),
                    .exact = row.exact,
                    .bullet = true,
                    .on_device = false});
  }
  for (const AlgorithmInfo& info : algorithms()) {
    rows.push_back({.name = std::string(info.name),
                    .summary = std::string(info.summary),
                    .exact = true,
                    .bullet = false,
                    .on_device = info.on_device});
  }
  return rows;
}

BroadphaseInfo find_broadphase(std::string_view name) {
  const std::string_view base = without_culling(name);
  const bool culls = base != name;
  std::string names;
  for (BroadphaseInfo& info : broadphases()) {
    if (info.name == base && !(culls && info.bullet)) {
      info.name = name;
      info.culls = culls;
      if (culls) info.summary += "; with shape culling";
      return info;
    }
    names += (names.empty() ? "" : ", ") + info.name;
  }
  throw Error("no broad phase is named '" + std::string(name) + "'; the broad phases are: " + names +
              ", those after Bullet's also with '+culling'");
}

std::unique_ptr<btBroadphaseInterface> make_broadphase(const BroadphaseConfig& config) {
  const auto* row = std::find_if(bullet_rows.begin(), bullet_rows.end(),
                                 [&](const BulletRow& own) { return own.name == config.name; });
  if (row != bullet_rows.end()) return row->make(config);
  const std::string name = find_broadphase(config.name).name;
  return std::make_unique<BulletBroadphase>(Config{.device = config.device,
                                                   .algorithm = std::string(without_culling(name)),
                                                   .profile = config.profile,
                                                   .on_compile = config.on_compile});
}

}  // namespace broadcl::scenes
