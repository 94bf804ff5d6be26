#pragma once

#include <Eigen/Core>
#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/filter.hpp>
#include <cstdint>
#include <functional>
#include <set>
#include <span>
#include <string_view>
#include <vector>

#include "scenes/random.hpp"

namespace broadcl::scenes {

class Motion;

/// A row of the table of motions.
struct MotionInfo {
  std::string_view name;
  /// Changes the objects with which Motion begins: cubes that each overlap about four others, and steps of
  /// a tenth of their edge.
  std::function<void(Motion&)> start;
  std::function<void(Motion&)> step;  ///< Makes the calls of a frame.
  bool whole = false;                 ///< Whether these are update(boxes) alone.
};

/// The table.
[[nodiscard]] std::span<const MotionInfo> motions();

/// The calls of one frame. Ids and boxes are those of a BroadPhase that got all frames so far.
template <class Box>
struct BasicMotionFrame {
  std::vector<std::uint32_t> removed{};  ///< Ascending, like `moved`.
  std::vector<Box> added{};
  std::vector<Filter> filters{};  ///< Of those that are added.
  std::vector<std::uint32_t> moved{};
  std::vector<Box> boxes{};  ///< Of those that move, or for update(boxes).
  bool whole = false;        ///< Whether update(boxes) is the only call.

  /// @param subject A BroadPhase, or a class with the same functions.
  /// @returns The changes.
  template <class Subject>
  auto play(Subject& subject) const {
    if (whole) return subject.update(BoxView(boxes));
    if (!removed.empty()) subject.remove(removed);
    if (!added.empty()) subject.add(BoxView(added), std::span(filters));
    if (!moved.empty()) subject.move(moved, BoxView(boxes));
    return subject.update();
  }
};
using MotionFrame = BasicMotionFrame<Aabb>;

/// Objects in motion, in the unit cube unless a scene says otherwise: the frames of a scene of the table,
/// which a benchmark can time and a test can give to several objects. Deterministic.
class Motion {
 public:
  /// @param info Must outlive this object.
  Motion(const MotionInfo& info, std::uint32_t count, std::uint64_t seed = 1);

  /// Makes the next frame; the first one adds all objects.
  [[nodiscard]] MotionFrame next();
  /// The boxes of all objects that exist, without gaps.
  [[nodiscard]] std::vector<Aabb> present() const;

  // For the functions of the table.

  std::vector<Aabb> boxes;             ///< By id.
  std::vector<Eigen::Vector3f> steps;  ///< By id, of the first objects: their way in a frame.
  std::vector<Filter> filters;         ///< By id.
  Random random;
  float edge;               ///< Of a cube.
  std::uint32_t frame = 0;  ///< The first one, which adds all objects, is 1.

  [[nodiscard]] std::uint32_t count() const { return static_cast<std::uint32_t>(boxes.size()); }
  [[nodiscard]] bool contains(std::uint32_t id) const { return !free_.contains(id); }
  void move(std::uint32_t id, const Aabb& box);
  /// In each frame before add().
  void remove(std::uint32_t id);
  void add(const Aabb& box);

 private:
  const MotionInfo& info_;
  std::set<std::uint32_t> free_;
  std::vector<std::uint32_t> removed_, added_, moved_;
};

}  // namespace broadcl::scenes
