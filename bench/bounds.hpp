#pragma once

#include <LinearMath/btVector3.h>

#include <vector>

#include "scenes/generators.hpp"

namespace broadcl {

/// A box in Bullet's types.
struct Bounds {
  btVector3 lower;
  btVector3 upper;
};

/// Boxes of a scene in units of its edge s, because Bullet's margins suit objects of about one unit.
[[nodiscard]] inline std::vector<Bounds> scaled(const scenes::MovingBoxes& boxes) {
  std::vector<Bounds> result;
  result.reserve(boxes.boxes().size());
  for (const auto& [lower, upper] : boxes.boxes()) {
    result.push_back({btVector3(lower[0], lower[1], lower[2]) / boxes.edge(),
                      btVector3(upper[0], upper[1], upper[2]) / boxes.edge()});
  }
  return result;
}

}  // namespace broadcl
