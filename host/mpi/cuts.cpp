#include "mpi/cuts.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

namespace broadcl::mpi {
namespace {

constexpr float largest = std::numeric_limits<float>::max();
constexpr float infinity = std::numeric_limits<float>::infinity();

/// The axis along which the points extend farthest.
std::uint32_t longest_axis(const Sample* begin, const Sample* end) {
  std::uint32_t longest = 0;
  double length = -1;
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    float least = infinity;
    float most = -infinity;
    for (const Sample* sample = begin; sample != end; ++sample) {
      least = std::min(least, sample->point[axis]);
      most = std::max(most, sample->point[axis]);
    }
    const double extent = static_cast<double>(most) - static_cast<double>(least);
    if (extent > length) {
      longest = axis;
      length = extent;
    }
  }
  return longest;
}

}  // namespace

Cuts::Cuts(std::size_t regions, std::vector<Sample> sample)
    : regions_(regions), cuts_(regions, Cut{.axis = 0, .at = 0}) {
  for (Sample& s : sample) {
    for (float& x : s.point) x = std::clamp(x, -largest, largest);  // cuts are finite
  }
  bisect(0, regions, sample.data(), sample.data() + sample.size());
}

void Cuts::bisect(std::size_t first, std::size_t count, Sample* begin, Sample* end) {
  if (count == 1 || begin == end) return;
  const std::size_t lower_half = count / 2;
  const std::uint32_t axis = longest_axis(begin, end);
  std::sort(begin, end, [axis](const Sample& s, const Sample& t) { return s.point[axis] < t.point[axis]; });
  const auto weight_until = [begin](Sample* until) {
    return std::accumulate(begin, until, 0.0,
                           [](double sum, const Sample& s) { return sum + static_cast<double>(s.weight); });
  };
  const double wanted = weight_until(end) * static_cast<double>(lower_half) / static_cast<double>(count);
  Sample* cut = begin;
  for (double below = 0; cut + 1 != end; ++cut) {
    const auto weight = static_cast<double>(cut->weight);
    if (below + weight / 2 >= wanted) break;
    below += weight;
  }
  // Equal points stay together, on the better side.
  const auto [least, past] = std::equal_range(
      begin, end, *cut, [axis](const Sample& s, const Sample& t) { return s.point[axis] < t.point[axis]; });
  const bool is_past_better = past != end && weight_until(past) - wanted < wanted - weight_until(least);
  Sample* const middle = is_past_better ? past : least;
  cuts_[first + lower_half] = {.axis = axis, .at = middle->point[axis]};
  bisect(first, lower_half, begin, middle);
  bisect(first + lower_half, count - lower_half, middle, end);
}

std::size_t Cuts::region_of(const Point& point) const noexcept {
  std::size_t first = 0;
  for (std::size_t count = regions_; count > 1;) {
    const std::size_t lower_half = count / 2;
    const Cut& cut = cuts_[first + lower_half];
    const bool is_below = point[cut.axis] < cut.at;
    if (!is_below) first += lower_half;
    count = is_below ? lower_half : count - lower_half;
  }
  return first;
}

Cuts::Bounds Cuts::bounds(std::size_t region) const noexcept {
  Bounds bounds;
  bounds.lower.fill(-infinity);
  bounds.upper.fill(infinity);
  std::size_t first = 0;
  for (std::size_t count = regions_; count > 1;) {
    const std::size_t lower_half = count / 2;
    const Cut& cut = cuts_[first + lower_half];
    if (region < first + lower_half) {
      bounds.upper[cut.axis] = std::min(bounds.upper[cut.axis], cut.at);
      count = lower_half;
    } else {
      bounds.lower[cut.axis] = std::max(bounds.lower[cut.axis], cut.at);
      first += lower_half;
      count -= lower_half;
    }
  }
  return bounds;
}

}  // namespace broadcl::mpi
