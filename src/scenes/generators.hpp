#pragma once

#include <broadcl/aabb.hpp>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "scenes/random.hpp"

namespace broadcl::scenes {

/// A named set of boxes that a broad phase must get right.
struct BoxScene {
  std::string name;
  std::vector<Aabb> boxes;
};

/// Scenes of `count` boxes each: ordinary boxes and every degenerate kind that breaks broad phases: points,
/// identical and touching boxes, flat and line-like sets, empty boxes, infinite and huge bounds (1e18, 1e30,
/// FLT_MAX), denormals, -0, coordinates far from the origin, one box around all others, boxes that all
/// overlap. Deterministic.
[[nodiscard]] std::vector<BoxScene> box_scenes(std::uint32_t count, std::uint64_t seed = 1);

/// The scene for timing broad phases: n cubes with centres uniform in the unit cube and an edge s such that
/// each overlaps about four others. In every frame each cube moves by s/10 in its own constant direction,
/// reflected at the walls.
class MovingBoxes {
 public:
  enum class Sizes {
    uniform,  ///< Every edge is s.
    mixed,    ///< f*s, f uniform in 0.1-0.4, 0.8-1.2 or 1.6-4.0, a third each: about 20 overlaps per box.
  };
  MovingBoxes(std::uint32_t count, Sizes sizes, std::uint64_t seed = 1);

  [[nodiscard]] std::span<const Aabb> boxes() const noexcept { return boxes_; }
  /// The edge s.
  [[nodiscard]] float edge() const noexcept { return edge_; }
  /// Advances to the next frame.
  void advance();

 private:
  void place_boxes();

  std::vector<Aabb> boxes_;
  std::vector<Eigen::Vector3f> centres_;
  std::vector<Eigen::Vector3f> steps_;
  std::vector<float> half_edges_;
  float edge_;
};

}  // namespace broadcl::scenes
