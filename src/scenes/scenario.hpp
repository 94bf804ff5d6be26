#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "scenes/random.hpp"

namespace broadcl::scenes {

/// A row of the table of scenarios.
struct ScenarioInfo {
  std::string_view name;
  std::string_view summary;  ///< One line for people.
};

/// The range of the edges of a class of objects: factors of an ordinary object's edge.
struct SizeClass {
  float lower;
  float upper;
};

/// Small, average and large objects, a third each.
inline constexpr std::array<SizeClass, 3> mixed_sizes{{{0.1F, 0.4F}, {0.8F, 1.2F}, {1.6F, 4.0F}}};

/// The four scenarios of Serpa and Rodrigues, "Parallelizing Broad Phase Collision Detection for Animation in
/// Games: A Performance Comparison of CPU and GPU Algorithms", SBGames 2014: objects in a cubic container
/// that fall, are agitated, or are thrown about by rotating gravity. A fifth scenario covers what the paper
/// leaves out: objects that come and go.
///
/// This is the script of a run, independent of any physics engine: where objects start, and how gravity and
/// velocities change in each frame. Metres, seconds, kilograms; y is up; the container is centred at the
/// origin. The same configuration gives the same script on every machine.
class Scenario {
 public:
  struct Config {
    std::string name;              ///< A name of list().
    std::uint32_t objects = 1250;  ///< 1 to max_objects.
    std::uint64_t seed = 1;
    bool spheres = false;  ///< Spheres of the same size instead of cubes.
  };
  struct Object {
    Eigen::Vector3f position;  ///< Of the centre, at frame 0, when no two objects overlap.
    Eigen::Vector3f velocity;  ///< At frame 0.
    float edge;                ///< Edge of the cube, or diameter of the sphere.
  };
  /// A new velocity for an object.
  struct Kick {
    std::uint32_t object;
    Eigen::Vector3f velocity;
  };

  /// An object that is replaced by one of the same size.
  struct Exchange {
    std::uint32_t object;
    Eigen::Vector3f position;  ///< Of the new object's centre.
    Eigen::Vector3f velocity;
  };

  /// @throws broadcl::Error for an unknown name, listing the known ones, and for zero or too many objects.
  explicit Scenario(const Config& config);

  /// The table of scenarios.
  [[nodiscard]] static std::span<const ScenarioInfo> list() noexcept;

  [[nodiscard]] const Config& config() const noexcept { return config_; }
  [[nodiscard]] std::span<const Object> objects() const noexcept { return objects_; }
  /// Inner edge of the container.
  [[nodiscard]] float container_edge() const noexcept { return container_edge_; }
  /// Gravity of the current frame.
  [[nodiscard]] const Eigen::Vector3f& gravity() const noexcept { return gravity_; }
  /// Velocities to set before the current frame is simulated.
  [[nodiscard]] std::span<const Kick> kicks() const noexcept { return kicks_; }
  /// Objects to exchange before the current frame is simulated; each once.
  [[nodiscard]] std::span<const Exchange> exchanges() const noexcept { return exchanges_; }
  /// Whether gravity changes from frame to frame, so that no body may sleep.
  [[nodiscard]] bool gravity_rotates() const noexcept { return rotates_; }
  /// Advances to the next frame. After construction the current frame is 0.
  void advance();

  static constexpr float frame_seconds = 1.0F / 30.0F;
  static constexpr std::uint32_t max_objects = 1U << 24;

 private:
  void draw_kicks();
  void draw_exchanges();

  Config config_;
  Random random_;
  std::vector<Object> objects_;
  std::vector<Kick> kicks_;
  std::vector<Exchange> exchanges_;
  double due_ = 0;  // exchanges still to be made; the fraction is carried over to later frames
  float container_edge_ = 0;
  Eigen::Vector3f gravity_;
  Eigen::Matrix3d axes_;  // the columns are e1, e2, e3 of the rotating gravity
  bool agitates_ = false;
  bool rotates_ = false;
  bool streams_ = false;
};

}  // namespace broadcl::scenes
