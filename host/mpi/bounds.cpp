#include "mpi/bounds.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "base/box_parts.hpp"
#include "base/packed_box.hpp"

namespace broadcl::mpi {
namespace {

/// A rank renews its bounds after this many updates, because its objects may need less space by then.
constexpr std::size_t longest_life = 128;
/// If bounds were true for fewer or more updates than this, the margin is doubled or halved.
constexpr std::size_t short_life = 8, long_life = 64;
constexpr std::size_t sample_size = 4096;
/// In cells.
constexpr float least_margin = 1.0F / 1024, most_margin = 1;

float centroid(const Aabb& box, std::size_t axis) noexcept {
  return 0.5F * box.lower[axis] + 0.5F * box.upper[axis];
}

/// Of packed boxes.
void extend(Aabb& box, const Aabb& by) noexcept {
  if (!is_proper(by)) return;
  for (std::size_t axis = 0; axis < 3; ++axis) {  // (a NaN of `box` is replaced)
    box.lower[axis] = box.lower[axis] <= by.lower[axis] ? box.lower[axis] : by.lower[axis];
    box.upper[axis] = box.upper[axis] >= by.upper[axis] ? box.upper[axis] : by.upper[axis];
  }
}

Aabb enlarged(Aabb box, float margin) noexcept {
  for (float& lower : box.lower) lower -= margin;
  for (float& upper : box.upper) upper += margin;
  return box;
}

/// Makes a box so small that it does not meet another one, and keeps as much of it as possible.
void cut(Aabb& box, const Aabb& other) noexcept {
  if (!packed_overlaps(box, other)) return;
  constexpr float infinity = std::numeric_limits<float>::infinity();
  constexpr float least_step = std::numeric_limits<float>::min();  // A processor may take less for zero.
  float most = 0;
  Aabb best = packed_empty();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float length = box.upper[axis] - box.lower[axis];
    Aabb below = box;
    Aabb above = box;
    below.upper[axis] = std::nextafter(other.lower[axis] - least_step, -infinity);
    above.lower[axis] = std::nextafter(other.upper[axis] + least_step, infinity);
    for (const Aabb& rest : {below, above}) {
      const float part = (rest.upper[axis] - rest.lower[axis]) / length;
      if (part > most) {
        most = part;
        best = rest;
      }
    }
  }
  box = best;
}

}  // namespace

Grid::Grid(std::span<const Aabb> sample) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::vector<float> centroids;
    for (const Aabb& box : sample) {
      if (const float c = centroid(box, axis); std::isfinite(c)) centroids.push_back(c);
    }
    if (centroids.empty()) return;
    std::ranges::sort(centroids);
    const auto quantile = [&](std::size_t hundredth) {
      return centroids[(centroids.size() - 1) * hundredth / 100];
    };
    for (const std::size_t border : {0U, 1U, 2U}) borders_[border][axis] = quantile(25 + 25 * border);
    lower_[axis] = quantile(2);
    upper_[axis] = quantile(98);
    cell_size_ = std::max(cell_size_, upper_[axis] / 4 - lower_[axis] / 4);  // finite
  }
}

bool Grid::is_large(const Aabb& box) const noexcept {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float c = centroid(box, axis);
    const bool is_ordinary = box.upper[axis] - box.lower[axis] <= cell_size_ &&
                             lower_[axis] - cell_size_ <= c && c <= upper_[axis] + cell_size_;
    if (!is_ordinary) return true;
  }
  return false;
}

Survey::Survey() {
  cells.fill(packed_empty());
}

void Survey::add(const Grid& grid, std::uint32_t id, const Aabb& box) {
  if (large.size() < most_large && grid.is_large(box)) {
    large.push_back({.id = id, .box = box});
  } else {
    extend(cells[grid.cell_of(Corners(box))], box);
  }
}

void Survey::add(const Grid& grid, const Survey& other) {
  for (std::size_t cell = 0; cell < cell_count; ++cell) {
    extend(cells[cell], other.cells[cell]);
  }
  for (const Large& one : other.large) add(grid, one.id, one.box);
}

std::vector<Aabb> sample_of(std::span<const Aabb> boxes) {
  std::vector<Aabb> sample;
  const std::size_t stride = boxes.size() / sample_size + 1;
  for (std::size_t id = 0; id < boxes.size(); id += stride) {
    if (is_proper(boxes[id])) sample.push_back(boxes[id]);
  }
  return sample;
}

Survey survey_of(const Grid& grid, std::span<const Aabb> boxes, const Threads& threads) {
  // By part, so that the ids of objects that are alone do not depend on the threads.
  constexpr std::size_t most_parts = 32;
  const std::size_t n = boxes.size();
  const std::size_t parts = std::min(most_parts, parts_of(n));
  std::vector<Survey> surveys(parts);
  parallel_for(parts, useful_threads(n, boxes_per_part, threads), [&](std::size_t part, std::size_t) {
    for (std::size_t id = n * part / parts; id < n * (part + 1) / parts; ++id) {
      if (is_proper(boxes[id])) surveys[part].add(grid, static_cast<std::uint32_t>(id), boxes[id]);
    }
  });
  Survey all;
  for (const Survey& survey : surveys) all.add(grid, survey);
  return all;
}

bool OwnBounds::are_due(std::size_t objects) const noexcept {
  return !are_there_ || age_ >= longest_life || 2 * objects < objects_;
}

void OwnBounds::renew(const Grid& grid, const Survey& survey, std::size_t objects) {
  std::vector<std::uint32_t> large_ids;
  for (const Survey::Large& large : survey.large) large_ids.push_back(large.id);
  // Nothing below throws.
  if (are_there_ && age_ < short_life) margin_ = std::min(2 * margin_, most_margin);
  if (age_ > long_life) margin_ = std::max(margin_ / 2, least_margin);
  grid_ = grid;
  large_ids_.swap(large_ids);
  const float margin = margin_ * grid.cell_size();
  bounds_.large.fill(packed_empty());
  for (std::size_t k = 0; k < survey.large.size(); ++k) {
    bounds_.large[k] = enlarged(survey.large[k].box, margin);
  }
  for (std::size_t cell = 0; cell < cell_count; ++cell) {
    bounds_.cells[cell] = enlarged(survey.cells[cell], margin);
    cells_[cell] = Corners(bounds_.cells[cell]);
  }
  objects_ = objects;
  age_ = 0;
  are_there_ = true;
}

std::size_t OwnBounds::place_of_large(std::uint32_t id, const Corners& box) const noexcept {
  const auto large = std::ranges::lower_bound(large_ids_, id);
  if (large == large_ids_.end() || *large != id) return outside;
  const Aabb& own = bounds_.large[static_cast<std::size_t>(large - large_ids_.begin())];
  return contains(Corners(own), box) ? alone : outside;
}

void Neighbours::set(std::size_t rank, const OwnBounds& own, std::span<const Bounds> all) {
  struct Other {
    std::uint32_t halo;
    Aabb box;
  };
  std::vector<Other> others;
  for (std::size_t other = 0; other < all.size(); ++other) {
    if (other == rank) continue;
    const auto halo = static_cast<std::uint32_t>(sends(rank, other) ? other : rank);
    const auto add = [&](const Aabb& box) {
      if (is_proper(box)) others.push_back({.halo = halo, .box = box});
    };
    std::ranges::for_each(all[other].cells, add);
    std::ranges::for_each(all[other].large, add);
  }
  std::ranges::stable_sort(others, {}, &Other::halo);
  candidates_.clear();
  for (std::size_t place = 0; place <= OwnBounds::alone; ++place) {
    begin_[place] = candidates_.size();
    Aabb hull = packed_empty();
    for (const auto& [halo, box] : others) {
      if (place != OwnBounds::alone && !packed_overlaps(box, own.get().cells[place])) continue;
      candidates_.push_back({.halo = halo, .box = Corners(box)});
      extend(hull, box);
    }
    hulls_[place] = Corners(hull);
  }
  begin_.back() = candidates_.size();
  interior_box_ = packed_empty();
  for (const Aabb& cell : own.get().cells) extend(interior_box_, cell);
  for (const auto& [halo, box] : others) cut(interior_box_, box);
}

void Neighbours::set_interior(std::size_t rank, std::span<const Aabb> interiors) {
  for (const Aabb& other : interiors.first(rank)) cut(interior_box_, other);
  interior_ = Corners(interior_box_);
}

}  // namespace broadcl::mpi
