#include "finders/tile_classes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "finders/tile_search.hpp"

namespace broadcl {
namespace {

constexpr std::size_t most_sampled = 256;

/// A filter is worth classes of its own if at least one in so many pairs of objects consists of one with this
/// filter and one that it refuses.
constexpr std::size_t pairs_per_refused = 8;

/// Shapes are worth classes of their own if these reduce the pairs of tiles at least to this share.
constexpr double worthwhile = 0.75;

/// Slots whose boxes are not empty. Their distances differ, since objects may be alike at regular ones.
std::vector<std::size_t> sample_of(std::span<const Aabb> boxes) {
  std::vector<std::size_t> sample;
  const std::size_t count = std::min(most_sampled, boxes.size());
  const double step = static_cast<double>(boxes.size()) / static_cast<double>(count);
  for (std::uint32_t k = 0; k < count; ++k) {
    const double offset = 0.618 * k;
    const auto slot = static_cast<std::size_t>((k + offset - std::floor(offset)) * step);
    if (!is_empty(boxes[slot])) sample.push_back(slot);
  }
  return sample;
}

using Lengths = std::array<double, 3>;  // along each axis

/// The largest edge of the boxes of a tile along an axis, on average.
double edge_of_tiles(std::span<const Lengths> edges, std::size_t axis) {
  const auto along_axis = [=](const Lengths& lengths) { return lengths.at(axis); };
  double sum = 0;
  double tiles = 0;
  for (; !edges.empty(); edges = edges.subspan(std::min(node_size, edges.size())), ++tiles)
    sum += along_axis(std::ranges::max(edges.first(std::min(node_size, edges.size())), {}, along_axis));
  return sum / tiles;
}

/// About how many pairs of tiles overlap if objects of different parts do not share tiles.
/// @param parts The edges of a sample.
/// @param scene The extent of all centres.
/// @param objects For each of the sample.
double pairs_of_tiles(std::span<const std::vector<Lengths>> parts, const Lengths& scene, double objects) {
  double pairs = 0;
  std::vector<std::pair<double, Lengths>> all;  // the number of tiles and their extent
  for (const std::vector<Lengths>& part : parts) {
    if (part.empty()) continue;
    const double tiles = objects * static_cast<double>(part.size()) / node_size;
    Lengths extent = scene;
    double in_part = tiles;
    while (in_part > 1) {
      in_part /= 2;
      *std::ranges::max_element(extent) /= 2;
    }
    for (std::size_t axis = 0; axis < 3; ++axis) extent.at(axis) += edge_of_tiles(part, axis);
    const auto pairs_with = [&](double others, const Lengths& other_extent) {
      double overlapping = tiles * others;
      for (std::size_t axis = 0; axis < 3; ++axis)
        overlapping *= std::min(1.0, (extent.at(axis) + other_extent.at(axis)) / scene.at(axis));
      return overlapping;
    };
    pairs += pairs_with(tiles / 2, extent);
    for (const auto& [others, other_extent] : all) pairs += pairs_with(others, other_extent);
    all.emplace_back(tiles, extent);
  }
  return pairs;
}

}  // namespace

TileClasses::TileClasses(const Input& input) : input_(input) {
  const std::vector<std::size_t> sample = sample_of(input.boxes);
  if (sample.empty()) return;
  std::vector<std::uint32_t> exponents;
  exponents.reserve(sample.size());
  for (const std::size_t slot : sample) exponents.push_back(size_exponent_of(slot));
  const auto median = exponents.begin() + static_cast<std::ptrdiff_t>(exponents.size() / 2);
  std::ranges::nth_element(exponents, median);
  median_ = *median;
  are_by_shape_ = should_be_by_shape(sample);
  if (!input.rules.filters.empty() && !input.rules.sets) find_refusing(sample);
}

bool TileClasses::should_be_by_shape(std::span<const std::size_t> sample) const {
  const auto shape = [&](std::size_t slot) { return shape_of(input_.boxes[slot]); };
  if (std::ranges::count(sample, shape(sample.front()), shape) == std::ssize(sample)) return false;
  std::vector<Lengths> together;
  std::array<std::vector<Lengths>, shapes> apart;
  constexpr float most = std::numeric_limits<float>::max();
  Bounds<3> centres = make_bounds<3>(most, -most);
  for (const std::size_t slot : sample) {
    const Aabb& box = input_.boxes[slot];
    Bounds<3> centre;
    Lengths& edges = together.emplace_back();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      edges.at(axis) = static_cast<double>(box.upper[axis]) - static_cast<double>(box.lower[axis]);
      centre.lower[axis] = centre.upper[axis] = box.lower[axis] / 2 + box.upper[axis] / 2;
    }
    apart.at(shape(slot)).push_back(edges);
    extend(centres, centre);
  }
  Lengths scene;
  for (std::size_t axis = 0; axis < 3; ++axis)
    scene.at(axis) = static_cast<double>(centres.upper[axis]) - static_cast<double>(centres.lower[axis]);
  const double objects = static_cast<double>(input_.boxes.size()) / static_cast<double>(sample.size());
  return pairs_of_tiles(apart, scene, objects) <
         worthwhile * pairs_of_tiles(std::span(&together, 1), scene, objects);
}

void TileClasses::find_refusing(std::span<const std::size_t> sample) {
  std::vector<Filter> filters;
  for (const std::size_t slot : sample) filters.push_back(input_.rules.filters[slot]);
  const auto groups = [](const Filter& filter) { return std::pair(filter.group, filter.mask); };
  std::ranges::sort(filters, {}, groups);
  for (auto next = filters.begin(); next != filters.end() && refusing_.size() < most_refusing;) {
    const Filter& filter = *next;
    const auto end = std::ranges::upper_bound(next, filters.end(), groups(filter), {}, groups);
    const auto same = static_cast<std::size_t>(end - next) * pairs_per_refused;
    next = end;
    if (same < filters.size()) continue;
    const auto refused =
        std::ranges::count_if(filters, [&](const Filter& other) { return refuse(filter, other); });
    if (same * static_cast<std::size_t>(refused) >= filters.size() * filters.size())
      refusing_.push_back(filter);
  }
}

}  // namespace broadcl
