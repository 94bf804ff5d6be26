#pragma once

#include <Eigen/Core>
#include <broadcl/aabb.hpp>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "scenes/motions.hpp"
#include "scenes/random.hpp"

namespace broadcl::scenes {

/// A row of the table of scenes with clusters of boxes.
struct ClustersInfo {
  std::string_view name;
  std::uint32_t boxes = 20'000;
  std::uint32_t clusters = 100;
  double edge = 1;            ///< Of the cubes.
  double reach = 6.4e6;       ///< How far from 0 clusters are at most, on each axis.
  int axes = 3;               ///< Clusters are at 0 on the others.
  std::uint32_t movers = 20;  ///< Cubes that drift in their cluster, always the same; at most all.
  double overlaps = 4;        ///< Of each cube, on average.
  bool flush = false;         ///< Whether the cubes of a cluster are side by side, and drift together.
  std::uint32_t planes = 0;   ///< The last boxes, which rest, and extend beyond all clusters on two axes.
  std::uint32_t convoy = 0;   ///< The first cubes, a cluster more, which all drift in it, while it travels.
  double speed = 0;           ///< How far the convoy gets in a frame, on its way from cluster to cluster.
  std::uint32_t jumps_every = 0;  ///< The number of frames after which the convoy is elsewhere; 0: never.
  std::uint32_t commuters = 0;    ///< Cubes that change to another cluster, others in each frame.
  bool whole = false;             ///< Whether all boxes are given in each frame, even if few move.
};

/// The table.
[[nodiscard]] std::span<const ClustersInfo> clusters();

/// Boxes in clusters far apart in double precision, and the same boxes in single precision with their
/// clusters side by side near 0. There are the same pairs, except those of planes and numbers that rounding
/// decides. Deterministic.
class Clusters {
 public:
  struct Frame {
    MotionFrame near;
    BasicMotionFrame<Aabb64> far;
  };

  explicit Clusters(const ClustersInfo& info, std::uint64_t seed = 1);

  /// Makes the next frame; the first one adds all objects.
  [[nodiscard]] Frame next();
  /// The boxes of the last frame, by id.
  [[nodiscard]] std::span<const Aabb> near() const noexcept { return near_; }
  [[nodiscard]] std::span<const Aabb64> far() const noexcept { return far_; }

 private:
  struct Cluster {
    Eigen::Vector3d far;
    Eigen::Vector3d near = Eigen::Vector3d::Zero();
    double size;
  };

  [[nodiscard]] Eigen::Vector3d anywhere();
  [[nodiscard]] Eigen::Vector3d far_away();
  void place(std::uint32_t id);
  void place_plane(std::uint32_t id);
  void drift(std::uint32_t id);
  void move_convoy();

  ClustersInfo info_;
  Random random_;
  std::vector<Cluster> clusters_;  // the first one is the convoy
  std::vector<std::uint32_t> cluster_of_;
  std::vector<Eigen::Vector3d> corners_, steps_;  // in the cluster
  std::vector<Aabb> near_;
  std::vector<Aabb64> far_;
  double near_size_ = 0;  // of all clusters
  std::uint32_t frame_ = 0;
  std::uint32_t stop_ = 1;  // the cluster to which the convoy travels
  std::vector<std::uint32_t> moved_;
};

}  // namespace broadcl::scenes
