#include "scenes/generators.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "scenes/scenario.hpp"

namespace broadcl::scenes {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();

/// The edge for which each of n cubes, with centres uniform in the unit cube, overlaps about four others.
float edge_for_four_overlaps(std::uint32_t count) {
  return static_cast<float>(1 - std::sqrt(1 - std::min(1.0, std::cbrt(4.0 / count))));
}

Eigen::Vector3f direction(Random& random) {
  Eigen::Vector3f v;
  do {
    v = random.vector(-1, 1);
  } while (v.squaredNorm() > 1 || v.squaredNorm() < 0.01F);
  return v.normalized();
}

Aabb to_aabb(const Eigen::Vector3f& lower, const Eigen::Vector3f& upper) {
  return {{lower.x(), lower.y(), lower.z()}, {upper.x(), upper.y(), upper.z()}};
}

Aabb cube(const Eigen::Vector3f& centre, float half_edge) {
  return to_aabb(centre.array() - half_edge, centre.array() + half_edge);
}

Aabb random_box(Random& random, float world_edge, float largest_edge) {
  const Eigen::Vector3f lower = random.vector(0, world_edge);
  return to_aabb(lower, lower + random.vector(0, largest_edge));
}

/// Makes the given number of boxes with a function that makes the k-th.
template <class Function>
std::vector<Aabb> make_boxes(std::uint32_t count, Function&& make) {
  std::vector<Aabb> boxes;
  boxes.reserve(count);
  for (std::uint32_t k = 0; k < count; ++k) boxes.push_back(make(k));
  return boxes;
}

/// The k-th point of a cubic grid that has at least the given number of points.
Eigen::Vector3f grid_point(std::uint32_t k, std::uint32_t count) {
  std::uint32_t edge = 1;
  while (std::uint64_t{edge} * edge * edge < count) ++edge;
  return Eigen::Matrix<std::uint32_t, 3, 1>(k % edge, k / edge % edge, k / edge / edge).cast<float>();
}

std::vector<Aabb> moving_boxes(std::uint32_t count, MovingBoxes::Sizes sizes, std::uint64_t seed) {
  const MovingBoxes scene(count, sizes, seed);
  return {scene.boxes().begin(), scene.boxes().end()};
}

std::vector<Aabb> points(std::uint32_t count, Random& random) {
  return make_boxes(count, [&](std::uint32_t k) {
    // Half as many grid points as boxes, so that points coincide; every other box is not a point.
    const Eigen::Vector3f corner = grid_point(random.index(count / 2 + 1), count);
    return to_aabb(corner, corner + Eigen::Vector3f::Constant(k % 2 == 0 ? 0.0F : 0.5F));
  });
}

std::vector<Aabb> touching(std::uint32_t count) {
  return make_boxes(count, [&](std::uint32_t k) {
    const Eigen::Vector3f corner = grid_point(k, count);
    return to_aabb(corner, corner + Eigen::Vector3f::Ones());
  });
}

/// Boxes one unit in the last place apart along x instead of touching.
std::vector<Aabb> almost_touching(std::uint32_t count) {
  return make_boxes(count, [&](std::uint32_t k) {
    const Eigen::Vector3f corner = grid_point(k, count);
    Eigen::Vector3f upper = corner + Eigen::Vector3f::Ones();
    upper.x() = std::nextafter(upper.x(), 0.0F);
    return to_aabb(corner, upper);
  });
}

std::vector<Aabb> flat(std::uint32_t count, Random& random) {
  return make_boxes(count, [&](std::uint32_t /*k*/) {
    Aabb box = random_box(random, 100, 20);
    box.lower[1] = box.upper[1] = 3;
    return box;
  });
}

std::vector<Aabb> line(std::uint32_t count, Random& random) {
  return make_boxes(count, [&](std::uint32_t /*k*/) {
    Aabb box = random_box(random, 100, 1);
    box.lower[0] = box.upper[0] = 0;
    box.lower[2] = box.upper[2] = -7;
    return box;
  });
}

/// Long thin boxes along all three axes that cross each other.
std::vector<Aabb> needles(std::uint32_t count, Random& random) {
  return make_boxes(count, [&](std::uint32_t k) {
    Aabb box = random_box(random, 100, 2);
    box.lower[k % 3] = 0;
    box.upper[k % 3] = 100;
    return box;
  });
}

std::vector<Aabb> clusters(std::uint32_t count, Random& random) {
  return make_boxes(count, [&](std::uint32_t k) {
    const Eigen::Vector3f centre = Eigen::Vector3f::Constant(1000.0F * static_cast<float>(k % 4));
    return cube(centre + random.vector(0, 1), 0.05F);
  });
}

/// Every other box is inverted on at least one axis, although the others surround it.
std::vector<Aabb> empty(std::uint32_t count, Random& random) {
  return make_boxes(count, [&](std::uint32_t k) {
    Aabb box = random_box(random, 10, 5);
    if (k % 8 == 1) return empty_aabb();
    if (k % 2 == 1) std::swap(box.lower[k / 2 % 3], box.upper[k / 2 % 3]);
    return box;
  });
}

/// Half-spaces, slabs, all of space, and boxes entirely at infinity, among ordinary boxes.
std::vector<Aabb> infinite(std::uint32_t count, Random& random) {
  return make_boxes(count, [&](std::uint32_t k) {
    Aabb box = random_box(random, 10, 2);
    const std::size_t axis = k / 6 % 3;
    switch (k % 6) {
      case 0:
        box.lower[axis] = -infinity;
        break;
      case 1:
        box.upper[axis] = infinity;
        break;
      case 2:
        box.lower[axis] = -infinity;
        box.upper[axis] = infinity;
        break;
      case 3:
        box.lower[axis] = box.upper[axis] = k % 4 == 3 ? infinity : -infinity;
        break;
      default:
        break;
    }
    if (k == 0) box = {{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}};
    return box;
  });
}

/// Bounds so large that squares or volumes overflow, among ordinary boxes.
std::vector<Aabb> huge(std::uint32_t count, float magnitude, Random& random) {
  return make_boxes(count, [&](std::uint32_t k) {
    Aabb box = random_box(random, 10, 2);
    const std::size_t axis = k / 4 % 3;
    if (k % 4 == 0) box.lower[axis] = -magnitude;
    if (k % 4 == 1) box.upper[axis] = magnitude;
    if (k % 4 == 2) box.lower[axis] = box.upper[axis] = random.uniform(-1, 1) * magnitude;
    if (k == 0) box = {{-magnitude, -magnitude, -magnitude}, {magnitude, magnitude, magnitude}};
    return box;
  });
}

/// Coordinates of a few times the smallest positive float: if they are flushed to zero, all boxes touch.
std::vector<Aabb> denormal(std::uint32_t count, Random& random) {
  constexpr float unit = std::numeric_limits<float>::denorm_min();
  return make_boxes(count, [&](std::uint32_t /*k*/) {
    const Eigen::Vector3f lower = random.vector(-50, 50).array().floor();
    const Eigen::Vector3f upper = lower.array() + random.vector(0, 10).array().floor();
    return to_aabb(lower * unit, upper * unit);
  });
}

/// Boxes that touch at zero, with either sign.
std::vector<Aabb> negative_zero(std::uint32_t count) {
  return make_boxes(count, [&](std::uint32_t k) {
    const float zero = k % 2 == 0 ? 0.0F : -0.0F;
    const std::uint32_t group = k / 4;
    const auto shift = static_cast<float>(group);
    const std::array<float, 2> x =
        k / 2 % 2 == 0 ? std::array<float, 2>{zero, 1} : std::array<float, 2>{-1, zero};
    return Aabb{{x[0], zero, shift}, {x[1], zero, shift + 0.5F}};
  });
}

/// Boxes so far away that adjacent floats are a whole unit apart.
std::vector<Aabb> far_from_origin(std::uint32_t count, Random& random) {
  return make_boxes(count, [&](std::uint32_t /*k*/) {
    const Eigen::Vector3f lower = random.vector(0, 100).array() + 1e7F;
    return to_aabb(lower, lower + random.vector(0, 20));
  });
}

std::vector<Aabb> one_around_all(std::uint32_t count, Random& random) {
  return make_boxes(count, [&](std::uint32_t k) {
    return k == count / 2 ? to_aabb(Eigen::Vector3f::Constant(-1), Eigen::Vector3f::Constant(102))
                          : random_box(random, 100, 2);
  });
}

std::vector<Aabb> all_overlapping(std::uint32_t count, Random& random) {
  return make_boxes(count, [&](std::uint32_t /*k*/) {
    const Eigen::Vector3f lower = random.vector(-10, 0);
    return to_aabb(lower, random.vector(0, 10));
  });
}

std::vector<Aabb> identical(std::uint32_t count) {
  return make_boxes(count, [](std::uint32_t /*k*/) { return Aabb{{1, 2, 3}, {2, 3, 4}}; });
}

}  // namespace

std::vector<BoxScene> box_scenes(std::uint32_t count, std::uint64_t seed) {
  Random random(seed);
  std::vector<BoxScene> scenes;
  const auto add = [&](std::string name, std::vector<Aabb> boxes) {
    scenes.push_back({.name = std::move(name), .boxes = std::move(boxes)});
  };
  add("uniform", moving_boxes(count, MovingBoxes::Sizes::uniform, seed));
  add("mixed", moving_boxes(count, MovingBoxes::Sizes::mixed, seed));
  add("points", points(count, random));
  add("identical", identical(count));
  add("touching", touching(count));
  add("almost-touching", almost_touching(count));
  add("flat", flat(count, random));
  add("line", line(count, random));
  add("needles", needles(count, random));
  add("clusters", clusters(count, random));
  add("empty", empty(count, random));
  add("infinite", infinite(count, random));
  add("huge-1e18", huge(count, 1e18F, random));
  add("huge-1e30", huge(count, 1e30F, random));
  add("huge-flt-max", huge(count, std::numeric_limits<float>::max(), random));
  add("denormal", denormal(count, random));
  add("negative-zero", negative_zero(count));
  add("far-from-origin", far_from_origin(count, random));
  add("one-around-all", one_around_all(count, random));
  add("all-overlapping", all_overlapping(count, random));
  return scenes;
}

MovingBoxes::MovingBoxes(std::uint32_t count, Sizes sizes, std::uint64_t seed)
    : edge_(edge_for_four_overlaps(count)) {
  Random random(seed);
  for (std::uint32_t k = 0; k < count; ++k) {
    const SizeClass& factors = sizes == Sizes::mixed ? mixed_sizes[k % mixed_sizes.size()] : SizeClass{1, 1};
    half_edges_.push_back(edge_ / 2 * random.uniform(factors.lower, factors.upper));
    centres_.push_back(random.vector(0, 1));
    steps_.emplace_back(direction(random) * (edge_ / 10));
  }
  random.shuffle(std::span(half_edges_));
  boxes_.resize(count);
  place_boxes();
}

void MovingBoxes::advance() {
  for (std::size_t k = 0; k < centres_.size(); ++k) {
    centres_[k] += steps_[k];
    for (int axis = 0; axis < 3; ++axis) {
      float& x = centres_[k][axis];
      if (x >= 0 && x <= 1) continue;
      x = x < 0 ? -x : 2 - x;
      steps_[k][axis] = -steps_[k][axis];
    }
  }
  place_boxes();
}

void MovingBoxes::place_boxes() {
  for (std::size_t k = 0; k < boxes_.size(); ++k) boxes_[k] = cube(centres_[k], half_edges_[k]);
}

}  // namespace broadcl::scenes
