#include "core/exact_boxes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/box_parts.hpp"
#include "base/floating_point.hpp"
#include "base/packed_box.hpp"
#include "base/parallel.hpp"
#include "base/prefetch.hpp"

namespace broadcl {
namespace {

/// The lower and upper bound of a box on an axis.
struct Interval {
  double lower;
  double upper;
};

/// How badly float32 resolves intervals about an origin: the sum of its steps there, as parts of the
/// intervals' lengths, 1 at most.
double badness(const std::vector<Interval>& intervals, double origin) {
  double sum = 0;
  for (const auto& [lower, upper] : intervals) {
    const double step = std::abs(lower - origin) * static_cast<double>(std::numeric_limits<float>::epsilon());
    sum += step < upper - lower ? step / (upper - lower) : 1;
  }
  return sum;
}

/// The median, or 0 if that is as good, since many numbers are exact there.
double origin_for(std::vector<Interval>& intervals) {
  if (intervals.empty()) return 0;
  const auto middle = intervals.begin() + static_cast<std::ptrdiff_t>(intervals.size() / 2);
  std::ranges::nth_element(intervals, middle, {}, &Interval::lower);
  const double median = middle->lower;
  return badness(intervals, median) < badness(intervals, 0) ? median : 0;
}

/// Rounds to the nearest float32, and what would be denormal to 0, as which some processors take it anyway.
float to_normal_float(double number) noexcept {
  const auto rounded = static_cast<float>(number);
  return std::abs(rounded) < std::numeric_limits<float>::min() ? 0.0F : rounded;
}

/// Whether two packed boxes that overlap have a bound in common.
bool touch(const Aabb& s, const Aabb& t) noexcept {
  bool any = false;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    any |= s.lower[axis] == t.upper[axis];
    any |= t.lower[axis] == s.upper[axis];
  }
  return any;
}

}  // namespace

ExactBoxes::ExactBoxes(const BoxView& first, const BoxView& second, std::size_t threads)
    : first_(first), second_(second), threads_(threads), is_flat_(is_flat(first) && is_flat(second)) {
  const DefaultFloatingPoint as_everywhere;
  origin_ = choose_origin();
}

/// (Empty boxes may have bounds far from all others.)
[[gnu::noinline]] std::array<double, 3> ExactBoxes::choose_origin() const {
  constexpr std::size_t most_samples = 128;
  const std::size_t step = (size() / most_samples) | 1;  // odd, since every second box is often of a kind
  std::array<std::vector<Interval>, 3> samples;
  for (std::size_t k = 0; k < size(); k += step) {
    const Aabb64 sample = box(k);
    if (!sample.is_proper()) continue;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Interval interval{sample.lower[axis], sample.upper[axis]};
      if (std::isfinite(interval.upper - interval.lower)) samples[axis].push_back(interval);
    }
  }
  return {origin_for(samples[0]), origin_for(samples[1]), origin_for(samples[2])};
}

std::size_t ExactBoxes::pack_to(std::span<Aabb> out) const {
  LowestFound invalid(size());
  for_each_part(size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    const DefaultFloatingPoint as_everywhere;
    if (const std::size_t first = pack(begin, end, out); first < end) invalid.add(first);
  });
  return invalid.get();
}

/// Returns the first box with a NaN, or `end`.
[[gnu::noinline]] std::size_t ExactBoxes::pack(std::size_t begin, std::size_t end,
                                               std::span<Aabb> out) const noexcept {
  for (std::size_t k = begin; k < end; ++k) {
    const Aabb64 exact = box(k);
    Aabb& packed = out[k];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      packed.lower[axis] = to_normal_float(exact.lower[axis] - origin_[axis]);
      packed.upper[axis] = to_normal_float(exact.upper[axis] - origin_[axis]);
    }
    if (is_flat_) {  // bounds in which no two boxes touch
      packed.lower[2] = -1;
      packed.upper[2] = 1;
    }
    if (!exact.is_proper()) [[unlikely]] {
      if (exact.has_nan()) return k;
      packed = packed_empty();
    }
  }
  return end;
}

void ExactBoxes::keep_overlapping(std::vector<Pair>& pairs, std::span<const Aabb> packed) const {
  constexpr std::size_t least_pairs = 1 << 14;  // per thread
  // One part per thread: what remains of each but the first is moved once more.
  const std::size_t parts = useful_threads(pairs.size(), least_pairs, threads_);
  const auto begin_of = [&](std::size_t part) { return pairs.size() * part / parts; };
  std::vector<std::size_t> kept(parts);
  parallel_for(parts, parts, [&](std::size_t part, std::size_t /*thread*/) {
    const DefaultFloatingPoint as_everywhere;
    const std::size_t begin = begin_of(part);
    kept[part] = keep(std::span(pairs).subspan(begin, begin_of(part + 1) - begin), packed);
  });
  auto end = pairs.begin() + static_cast<std::ptrdiff_t>(kept[0]);
  for (std::size_t part = 1; part < parts; ++part) {
    const auto begin = pairs.begin() + static_cast<std::ptrdiff_t>(begin_of(part));
    end =
        end == begin ? begin + static_cast<std::ptrdiff_t>(kept[part]) : std::copy_n(begin, kept[part], end);
  }
  pairs.erase(end, pairs.end());
}

/// Moves the pairs that remain to the front; returns how many.
[[gnu::noinline]] std::size_t ExactBoxes::keep(std::span<Pair> pairs,
                                               std::span<const Aabb> packed) const noexcept {
  constexpr std::size_t ahead = 16;
  std::size_t count = 0;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (k + ahead < pairs.size()) prefetch(&packed[pairs[k + ahead].a]);
    const Pair pair = pairs[k];
    if (touch(packed[pair.a], packed[pair.b]) && !box(pair.a).overlaps(box(pair.b))) continue;
    pairs[count++] = pair;
  }
  return count;
}

}  // namespace broadcl
