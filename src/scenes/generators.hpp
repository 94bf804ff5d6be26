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

/// Boxes of about the given number in each scene: ordinary ones, and every degenerate kind that breaks broad
/// phases: points, identical and touching boxes, flat and line-like sets, empty ones, infinite and huge
/// bounds (1e18, 1e30, FLT_MAX), denormals, -0, coordinates far from the origin, one box around all, all
/// overlapping. Deterministic.
[[nodiscard]] std::vector<BoxScene> box_scenes(std::uint32_t count, std::uint64_t seed = 1);

/// The scene in which broad phases are timed: n cubes, centres uniform in the unit cube, of an edge s such
/// that each overlaps about four others; every frame each moves by s/10 in its own constant direction,
/// reflected at the walls.
class MovingBoxes {
 public:
  enum class Sizes {
    uniform,  ///< Every edge is s.
    mixed,    ///< A third each of f*s with f uniform in 0.1-0.4, 0.8-1.2, 1.6-4.0: about 20 overlaps a box.
  };
  MovingBoxes(std::uint32_t count, Sizes sizes, std::uint64_t seed = 1);

  [[nodiscard]] std::span<const Aabb> boxes() const noexcept { return boxes_; }
  /// The edge s.
  [[nodiscard]] float edge() const noexcept { return edge_; }
  /// Goes to the next frame.
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
