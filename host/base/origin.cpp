#include "base/origin.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/floating_point.hpp"

namespace broadcl {
namespace {

/// The lower and upper bound of a box on an axis.
struct Interval {
  double lower;
  double upper;
};

/// Those of the boxes that are neither empty nor infinite. (Empty boxes may have bounds far from all others.)
std::vector<Interval> intervals_of(std::span<const Aabb64> boxes, std::size_t axis) {
  std::vector<Interval> intervals;
  for (const Aabb64& box : boxes) {
    const Interval interval{box.lower[axis], box.upper[axis]};
    if (!is_empty(box) && std::isfinite(interval.upper - interval.lower)) intervals.push_back(interval);
  }
  return intervals;
}

/// The sum of float32's steps at the intervals about a place, as parts of their lengths, 1 at most. Those
/// without a length, such as points, count as if they stood side by side.
double badness_at(double place, const std::vector<Interval>& intervals) {
  if (intervals.empty()) return 0;
  const auto [first, last] = std::ranges::minmax_element(intervals, {}, &Interval::lower);
  const double distance = (last->lower - first->lower) / static_cast<double>(intervals.size());
  double sum = 0;
  for (const auto& [lower, upper] : intervals) {
    const double length = upper > lower ? upper - lower : distance;
    const double step = std::abs(lower - place) * static_cast<double>(std::numeric_limits<float>::epsilon());
    sum += step < length ? step / length : 1;
  }
  return sum;
}

[[gnu::noinline]] double best_place(std::vector<Interval> intervals) {
  if (intervals.empty()) return 0;
  const auto middle = intervals.begin() + static_cast<std::ptrdiff_t>(intervals.size() / 2);
  std::ranges::nth_element(intervals, middle, {}, &Interval::lower);
  const double median = middle->lower;
  return badness_at(median, intervals) < badness_at(0, intervals) ? median : 0;
}

[[gnu::noinline]] double badness_at(const std::array<double, 3>& place, std::span<const Aabb64> boxes) {
  double sum = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) sum += badness_at(place[axis], intervals_of(boxes, axis));
  return sum;
}

/// Rounds to the nearest float32, and what would be denormal to 0, as which some processors take it anyway.
float to_normal_float(double number) noexcept {
  const auto rounded = static_cast<float>(number);
  return std::abs(rounded) < std::numeric_limits<float>::min() ? 0.0F : rounded;
}

[[gnu::noinline]] void convert_all(const std::array<double, 3>& place, bool is_flat,
                                   std::span<const Aabb64> boxes, std::span<Aabb> out) noexcept {
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const Aabb64& box = boxes[k];
    Aabb& converted = out[k];
    bool is_proper = true;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      converted.lower[axis] = to_normal_float(box.lower[axis] - place[axis]);
      converted.upper[axis] = to_normal_float(box.upper[axis] - place[axis]);
      is_proper &= box.lower[axis] <= box.upper[axis];
    }
    if (is_flat && is_proper) {
      converted.lower[2] = -1;
      converted.upper[2] = 1;
    }
    if (!is_proper && !has_nan(box)) [[unlikely]]
      converted = empty_aabb();
  }
}

}  // namespace

Origin::Origin(std::span<const Aabb64> samples, bool is_flat) : is_flat_(is_flat) {
  const DefaultFloatingPoint as_everywhere;
  for (std::size_t axis = 0; axis < 3; ++axis) place_[axis] = best_place(intervals_of(samples, axis));
}

double Origin::badness(std::span<const Aabb64> samples) const {
  const DefaultFloatingPoint as_everywhere;
  return badness_at(place_, samples);
}

void Origin::convert(std::span<const Aabb64> boxes, std::span<Aabb> out) const noexcept {
  const DefaultFloatingPoint as_everywhere;
  convert_all(place_, is_flat_, boxes, out);
}

}  // namespace broadcl
