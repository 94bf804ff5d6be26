#include "scenes/clusters.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace broadcl::scenes {
namespace {

using Eigen::Vector3d;

constexpr double millimetre = 1e-3;

/// Of a cubic grid, by number.
Vector3d point(std::uint32_t k, std::uint32_t row) {
  return Eigen::Matrix<std::uint32_t, 3, 1>(k % row, k / row % row, k / row / row).cast<double>();
}

}  // namespace

std::span<const ClustersInfo> clusters() {
  static const std::vector<ClustersInfo> rows{
      {.name = "one-dense", .boxes = 100'000, .clusters = 1, .movers = 1, .overlaps = 40},
      {.name = "one-dense", .boxes = 100'000, .clusters = 1, .movers = 10, .overlaps = 40},
      {.name = "one-dense", .boxes = 100'000, .clusters = 1, .movers = 100, .overlaps = 40},
      {.name = "one-dense", .boxes = 100'000, .clusters = 1, .movers = 1'000, .overlaps = 40},
      {.name = "one", .boxes = 100'000, .clusters = 1, .movers = 1},
      {.name = "one", .boxes = 100'000, .clusters = 1, .movers = 10},
      {.name = "one", .boxes = 100'000, .clusters = 1, .movers = 100},
      {.name = "one", .boxes = 100'000, .clusters = 1, .movers = 1'000},
      {.name = "one", .boxes = 100'000, .clusters = 1, .movers = 100'000},
      {.name = "towns", .edge = millimetre},
      {.name = "towns-whole", .edge = millimetre, .whole = true},
      {.name = "towns", .edge = millimetre, .movers = 20'000},
      {.name = "towns-and-plane", .edge = millimetre, .planes = 1},
      {.name = "towns-and-plane", .edge = millimetre, .movers = 20'000, .planes = 1},
      {.name = "1000-towns", .clusters = 1'000, .edge = millimetre},
      {.name = "1000-towns", .clusters = 1'000, .edge = millimetre, .movers = 1'000},
      {.name = "1000-towns", .clusters = 1'000, .edge = millimetre, .movers = 20'000},
      {.name = "eight", .clusters = 8, .reach = 1e7},
      {.name = "eight-whole", .clusters = 8, .reach = 1e7, .whole = true},
      {.name = "eight", .clusters = 8, .reach = 1e7, .movers = 20'000},
      {.name = "two", .clusters = 2, .edge = millimetre, .reach = 1e7, .axes = 1},
      {.name = "two-whole", .clusters = 2, .edge = millimetre, .reach = 1e7, .axes = 1, .whole = true},
      {.name = "two", .clusters = 2, .edge = millimetre, .reach = 1e7, .axes = 1, .movers = 20'000},
      {.name = "convoy", .clusters = 8, .reach = 1e7, .movers = 0, .convoy = 20, .speed = 10},
      {.name = "convoy", .clusters = 8, .reach = 1e7, .movers = 0, .convoy = 200, .speed = 10},
      {.name = "fast-convoy", .clusters = 8, .reach = 1e7, .movers = 0, .convoy = 20, .speed = 1e5},
      {.name = "fast-convoy", .clusters = 8, .reach = 1e7, .movers = 0, .convoy = 200, .speed = 1e5},
      {.name = "town-drifts", .edge = millimetre, .movers = 20'000, .convoy = 200, .speed = 1},
      {.name = "town-jumps", .edge = millimetre, .movers = 20'000, .convoy = 200, .jumps_every = 10},
      {.name = "commuters", .edge = millimetre, .movers = 0, .commuters = 20},
      {.name = "commuters", .edge = millimetre, .movers = 0, .commuters = 1'000},
      {.name = "grid", .clusters = 1, .edge = 0.1, .movers = 1, .overlaps = 8, .flush = true},
      {.name = "grid", .clusters = 1, .edge = 0.1, .movers = 20'000, .overlaps = 8, .flush = true},
  };
  return rows;
}

Clusters::Clusters(const ClustersInfo& info, std::uint64_t seed)
    : info_(info),
      random_(seed),
      cluster_of_(info.boxes),
      corners_(info.boxes),
      steps_(info.boxes),
      near_(info.boxes),
      far_(info.boxes) {
  std::vector<std::uint32_t> sizes(info.clusters + 1);
  for (std::uint32_t id = 0; id < info.boxes; ++id) {
    if (id >= info.convoy) cluster_of_[id] = 1 + (id - info.convoy) % info.clusters;
    ++sizes[cluster_of_[id]];
  }
  double largest = 0;
  for (const std::uint32_t size : sizes) {
    clusters_.push_back({.far = far_away(), .size = 2 * info.edge * std::cbrt(size / info.overlaps)});
    largest = std::max(largest, clusters_.back().size);
  }
  const auto row = static_cast<std::uint32_t>(std::ceil(std::cbrt(clusters_.size())));
  const double distance = largest + 2 * info.edge;
  near_size_ = row * distance;
  for (std::uint32_t k = 0; k < clusters_.size(); ++k) {
    clusters_[k].near = point(k, row) * distance - Vector3d::Constant(near_size_ / 2);
  }
  const Vector3d together = anywhere().normalized() * info.edge / 10;
  std::ranges::fill(sizes, 0);
  for (std::uint32_t id = 0; id < info.boxes; ++id) {
    const std::uint32_t cluster = cluster_of_[id];
    const std::uint32_t k = sizes[cluster]++;
    const auto edge = static_cast<std::uint32_t>(std::ceil(clusters_[cluster].size / info.edge - 1e-3));
    steps_[id] = info.flush ? together : (2 * anywhere() - Vector3d::Ones()).normalized() * info.edge / 10;
    corners_[id] =
        info.flush ? Vector3d(point(k, edge) * info.edge) : Vector3d(anywhere() * clusters_[cluster].size);
    place(id);
  }
  for (std::uint32_t k = 0; k < info.planes; ++k) place_plane(info.boxes - 1 - k);
}

Clusters::Frame Clusters::next() {
  if (frame_++ == 0) {
    const std::vector<Filter> filters(info_.boxes);
    return {.near = {.added = near_, .filters = filters}, .far = {.added = far_, .filters = filters}};
  }
  moved_.clear();
  if (info_.convoy > 0) move_convoy();
  const std::uint32_t others = info_.boxes - info_.convoy - info_.planes;
  const std::uint32_t movers = std::min(info_.movers, others);
  for (std::uint32_t id = 0; id < info_.convoy; ++id) drift(id);
  for (std::uint32_t k = 0; k < movers; ++k) {
    drift(info_.convoy + static_cast<std::uint32_t>(std::uint64_t{others} * k / movers));
  }
  for (std::uint32_t k = 0; k < info_.commuters; ++k) {
    const std::uint32_t id = info_.convoy + random_.index(others);
    cluster_of_[id] = 1 + random_.index(info_.clusters);
    corners_[id] = anywhere() * clusters_[cluster_of_[id]].size;
    place(id);
  }
  std::ranges::sort(moved_);
  moved_.erase(std::unique(moved_.begin(), moved_.end()), moved_.end());
  if (info_.whole || moved_.size() + info_.planes == info_.boxes) {
    return {.near = {.boxes = near_, .whole = true}, .far = {.boxes = far_, .whole = true}};
  }
  Frame frame{.near = {.moved = moved_}, .far = {.moved = moved_}};
  for (const std::uint32_t id : moved_) {
    frame.near.boxes.push_back(near_[id]);
    frame.far.boxes.push_back(far_[id]);
  }
  return frame;
}

Vector3d Clusters::anywhere() {
  return random_.vector(0, 1).cast<double>();
}

Vector3d Clusters::far_away() {
  Vector3d place = (2 * anywhere() - Vector3d::Ones()) * info_.reach;
  for (int axis = info_.axes; axis < 3; ++axis) place[axis] = 0;
  return place;
}

void Clusters::place(std::uint32_t id) {
  const Cluster& cluster = clusters_[cluster_of_[id]];
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = static_cast<std::size_t>(axis);
    const double near = cluster.near[axis] + corners_[id][axis];
    const double far = cluster.far[axis] + corners_[id][axis];
    near_[id].lower[k] = static_cast<float>(near);
    near_[id].upper[k] = static_cast<float>(near + info_.edge);
    far_[id].lower[k] = far;
    far_[id].upper[k] = far + info_.edge;
  }
  moved_.push_back(id);
}

/// Through the middle of a cluster.
void Clusters::place_plane(std::uint32_t id) {
  const Cluster& cluster = clusters_[id % clusters_.size()];
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = static_cast<std::size_t>(axis);
    const bool is_thin = k == (id + 2) % 3;
    const double near = is_thin ? cluster.near[axis] + cluster.size / 2 : near_size_;
    const double far = is_thin ? cluster.far[axis] + cluster.size / 2 : 2 * info_.reach;
    near_[id].lower[k] = static_cast<float>(is_thin ? near : -near);
    near_[id].upper[k] = static_cast<float>(near);
    far_[id].lower[k] = is_thin ? far : -far;
    far_[id].upper[k] = far;
  }
}

void Clusters::drift(std::uint32_t id) {
  const double size = clusters_[cluster_of_[id]].size;
  Vector3d& step = steps_[id];
  if (info_.flush && frame_ % 16 == 0) step = -step;
  for (int axis = 0; axis < 3; ++axis) {
    double& corner = corners_[id][axis];
    if (!info_.flush && (corner + step[axis] < 0 || corner + step[axis] > size)) step[axis] = -step[axis];
    corner += step[axis];
  }
  place(id);
}

/// It passes by each cluster, one after the other.
void Clusters::move_convoy() {
  Cluster& convoy = clusters_.front();
  if (info_.jumps_every > 0 && frame_ % info_.jumps_every == 0) convoy.far = far_away();
  if (info_.speed == 0) return;
  const Cluster& target = clusters_[stop_];
  const Vector3d way = target.far + Vector3d::Constant(2 * target.size) - convoy.far;
  if (way.norm() < info_.speed) stop_ = 1 + stop_ % info_.clusters;
  convoy.far += way.normalized() * std::min(info_.speed, way.norm());
}

}  // namespace broadcl::scenes
