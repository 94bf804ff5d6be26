#include "base/coordinate_map.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>

#include "base/box_parts.hpp"
#include "base/floating_point.hpp"

namespace broadcl {
namespace {

constexpr double infinite = std::numeric_limits<double>::infinity();
constexpr float infinite32 = std::numeric_limits<float>::infinity();

using Range = std::array<double, 2>;

double length(const Range& range) noexcept {
  return range[1] - range[0];
}

void extend(Range& range, double bound) noexcept {
  range = {std::min(range[0], bound), std::max(range[1], bound)};
}

/// (Near the largest number, differences overflow.)
bool is_infinite(double bound) noexcept {
  return !(-0x1p1000 <= bound && bound < 0x1p1000);
}

/// How far from 0 float32's steps are at most 1/256 of a size.
double reach_of(double size) noexcept {
  return 0x1p15 * size;
}

/// How long windows are beside k intervals of some length together.
double window_of(std::size_t k, double length, double size) noexcept {
  return length / static_cast<double>(k) + 8 * size;
}

/// How far from 0 images are then.
double extent_of(std::size_t k, double length, double size) noexcept {
  return (length + static_cast<double>(3 * k + 2) * window_of(k, length, size)) / 2;
}

/// Joins parts until of the widest gaps between them only those remain that make a difference.
std::vector<Range> joined(const std::vector<Range>& parts, double size) {
  constexpr std::size_t most = 999;
  std::vector<double> gaps;
  double sum = length(parts.front());
  for (std::size_t k = 1; k < parts.size(); ++k) {
    gaps.push_back(parts[k][0] - parts[k - 1][1]);
    sum += length(parts[k]);
  }
  std::size_t cut = std::min(gaps.size(), most);
  const auto others = gaps.begin() + static_cast<std::ptrdiff_t>(cut);
  std::partial_sort(gaps.begin(), others, gaps.end(), std::greater());
  for (sum = std::accumulate(others, gaps.end(), sum); cut > 0; sum += gaps[--cut]) {
    const double extent = extent_of(cut, sum + gaps[cut - 1], size);
    if (extent > reach_of(size) && extent > extent_of(cut + 1, sum, size)) break;
  }
  std::vector<Range> intervals{parts.front()};
  for (const Range& part : std::span(parts).subspan(1)) {
    if (intervals.size() <= cut && part[0] - intervals.back()[1] >= gaps[cut - 1]) {
      intervals.push_back(part);
    } else {
      intervals.back()[1] = part[1];
    }
  }
  return intervals;
}

/// The nearest float32, and 0 for what may be denormal, since some processors take that for 0 anyway.
float image_of(double number) noexcept {
  return static_cast<float>(std::abs(number) < 0x1p-126 ? 0 : number);
}

/// By how much numbers near 0 change if they become images, and others when these are moved back by -shift.
double error_of(double shift) noexcept {
  return std::abs(shift) * 0x1p-50 + 0x1p-125;
}

bool is_window(std::size_t piece) noexcept {
  return piece % 2 != 0;
}

}  // namespace

[[gnu::noinline]] void CoordinateMap::Survey::add(std::size_t axis, std::span<const Aabb64> boxes) noexcept {
  for (const Aabb64& box : boxes) {
    const double lower = box.lower[axis];
    const double upper = box.upper[axis];
    if (!is_infinite(lower)) extend(range, lower);
    if (!is_infinite(upper)) extend(range, upper);
    // (Sizes up to the largest number would overflow what is computed from them.)
    if (is_infinite(lower) || is_infinite(upper) || !(lower < upper)) continue;
    ++sizes[std::bit_cast<std::uint64_t>(upper - lower) >> 52U];
  }
}

void CoordinateMap::Survey::add(const Survey& other) noexcept {
  range = {std::min(range[0], other.range[0]), std::max(range[1], other.range[1])};
  std::ranges::transform(sizes, other.sizes, sizes.begin(), std::plus());
}

[[gnu::noinline]] CoordinateMap::Axis::Axis(const Survey& survey, std::size_t boxes, bool keeps_distances) {
  const auto& [range, sizes] = survey;
  if (range[0] > range[1]) return;
  // If they are points, their distance if they were in a line.
  double least = length(range) > 0 ? length(range) / static_cast<double>(boxes) : 1;
  const std::size_t sized = std::accumulate(sizes.begin(), sizes.end(), std::size_t{0});
  for (std::size_t k = 0, seen = 0; sized > 0 && seen <= sized / 64; seen += sizes[k++]) {
    least = std::ldexp(1, static_cast<int>(k) - 1023);
  }
  const double largest = std::max(-range[0], range[1]);
  least = std::ldexp(1, std::ilogb(std::max({least, 0x1p-900, 0x1p-1000 * largest})));
  const bool is_about_0 = largest <= reach_of(least);  // where many numbers are exact
  const double place = is_about_0 ? 0 : range[0] / 2 + range[1] / 2;
  const double distance = is_about_0 ? largest : length(range) / 2;
  const double reach = std::max(reach_of(least), distance);
  if (keeps_distances) {
    pieces = {{}, {place}, {}};
  } else {
    *this = Axis({{place - reach, place + reach}}, least);
  }
  extent = distance;
}

bool CoordinateMap::Axis::is_fine() const noexcept {
  return pieces.size() == 1 || extent <= reach_of(size);
}

[[gnu::noinline]] void CoordinateMap::Axis::cut(std::span<const double> bounds) {
  while (!is_fine()) {
    const float low = pieces[1].low;
    const double count = std::clamp(static_cast<double>(bounds.size()) / 4, 4096.0, 131072.0);
    const double per_image = count / static_cast<double>(pieces[pieces.size() - 2].high - low);
    std::vector<Range> parts(static_cast<std::size_t>(count) + 1, {infinite, -infinite});
    std::size_t number = 1;
    for (const double bound : bounds) {
      if (is_infinite(bound)) continue;
      const double scaled = bound * scale;
      if (!(thresholds[number - 1] <= scaled && scaled < thresholds[number])) number = piece_of(scaled);
      const Piece& piece = pieces[number];
      const float image = std::clamp(image_of(scaled - piece.shift), piece.low, piece.high);
      extend(parts[static_cast<std::size_t>(static_cast<double>(image - low) * per_image)], bound);
    }
    std::erase_if(parts, [](const Range& part) { return part[0] > part[1]; });
    Axis finer(joined(parts, size), size);
    if (finer.extent > extent / 2) break;
    *this = std::move(finer);
  }
}

[[gnu::noinline]] CoordinateMap::Axis::Axis(const std::vector<Range>& intervals, double least) : size(least) {
  const std::size_t k = intervals.size();
  double sum = 0;
  for (const Range& interval : intervals) sum += length(interval);
  extent = extent_of(k, sum, size);
  if (extent < 0x1p-60 || extent > 0x1p100) scale = std::ldexp(1, -std::ilogb(extent));
  inverse = 1 / scale;
  unit = std::ldexp(scale, std::ilogb(window_of(k, sum, size)) - 3);
  const auto rounded_up = [&](double number) { return std::ceil(number / unit) * unit; };
  const double window = 2 * rounded_up(window_of(k, sum, size) * scale / 2);
  const auto images_of = [&](const Range& of) { return rounded_up(length(of) * scale + window) + 2 * unit; };
  const auto margin_before = [&](std::size_t i) {
    const double gap = i % k == 0 ? infinite : intervals[i][0] - intervals[i - 1][1];
    return std::min(gap * scale / 4, window / 2);
  };

  double at = static_cast<double>(k + 1) * window + static_cast<double>(2 * k) * unit;
  for (const Range& interval : intervals) at += images_of(interval);
  at = rounded_up(-at / 2);
  const auto add = [&](double threshold, double image, double images) {
    const double shift = -rounded_up(-threshold) - image;
    pieces.push_back({shift, image_of(at), image_of(at + images)});
    at += images + unit;
  };
  thresholds = {std::max(-0x1p1000 * scale, std::numeric_limits<double>::lowest())};
  pieces = {{0, -infinite32, -infinite32}};
  for (std::size_t i = 0; i < k; ++i) {
    const double begin = std::max(intervals[i][0] * scale - margin_before(i), thresholds.front());
    const double upper = intervals[i][1] * scale;
    const double end = std::max(upper + margin_before(i + 1), std::nextafter(upper, infinite));
    i == 0 ? add(begin, at + window - unit, window) : add(thresholds.back(), at, window);
    add(begin, at + unit, images_of(intervals[i]));
    thresholds.insert(thresholds.end(), {begin, std::min(end, -thresholds.front())});
  }
  add(thresholds.back(), at, window);
  pieces.push_back({0, infinite32, infinite32});
  const double distance = std::min(thresholds[2] - pieces[2].shift, pieces[2].shift - thresholds[1]);
  limit = k > 1 || scale != 1 ? 0 : std::nextafter(distance, 0);

  const std::size_t buckets = 8 * k;
  first = thresholds[1];
  per_unit = std::min(static_cast<double>(buckets) / (thresholds.back() - first), 0x1p1000);
  last = static_cast<double>(buckets + 1);
  thresholds.push_back(-thresholds.front());
  before.resize(buckets + 3);
  for (const double threshold : thresholds) ++before[bucket_of(threshold) + 1];
  std::partial_sum(before.begin(), before.end(), before.begin());
  thresholds.insert(thresholds.end(), 2, std::numeric_limits<double>::quiet_NaN());
}

/// The first and the last bucket are for what is before and after the others.
inline std::size_t CoordinateMap::Axis::bucket_of(double scaled) const noexcept {
  const double bucket = (scaled - first) * per_unit + 1;
  return static_cast<std::size_t>(static_cast<int>(bucket > 0 ? std::min(last, bucket) : 0));
}

/// The number of thresholds that are not above.
inline std::size_t CoordinateMap::Axis::piece_of(double scaled) const noexcept {
  const std::size_t bucket = bucket_of(scaled);
  const std::size_t begin = before[bucket];
  const std::size_t end = before[bucket + 1];
  const double* const numbers = thresholds.data();
  if (end - begin > 2) [[unlikely]] {
    return static_cast<std::size_t>(std::upper_bound(numbers + begin, numbers + end, scaled) - numbers);
  }
  return begin + std::size_t{numbers[begin] <= scaled} + std::size_t{numbers[begin + 1] <= scaled};
}

[[gnu::noinline]] unsigned CoordinateMap::Axis::convert(std::size_t axis, std::span<const Aabb64> boxes,
                                                        std::span<Aabb> out) const noexcept {
  if (!(limit > 0)) return convert_by_piece(axis, boxes, out);
  const double shift = pieces[pieces.size() / 2].shift;
  double least = 0, greatest = 0, error_of_lower = 0, error_of_upper = 0;
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const auto& [lower, upper] = boxes[k];
    const double from = lower[axis] - shift;
    const double to = upper[axis] - shift;
    out[k].lower[axis] = image_of(from);
    out[k].upper[axis] = image_of(to);
    const double of_lower = static_cast<double>(out[k].lower[axis]) + shift - lower[axis];
    const double of_upper = static_cast<double>(out[k].upper[axis]) + shift - upper[axis];
    // (The second argument does not count if it is NaN.)
    least = std::min(least, from);
    greatest = std::max(greatest, to);
    error_of_lower = std::max(error_of_lower, std::abs(of_lower));
    error_of_upper = std::max(error_of_upper, std::abs(of_upper));
  }
  if (least < -limit || greatest > limit) return convert_by_piece(axis, boxes, out);
  return error_of_lower + error_of_upper > 0 ? 1U << axis : 0;
}

[[gnu::noinline]] unsigned CoordinateMap::Axis::convert_by_piece(std::size_t axis,
                                                                 std::span<const Aabb64> boxes,
                                                                 std::span<Aabb> out) const noexcept {
  double error = 0;
  unsigned found = 0;
  const auto convert = [&](double bound, std::size_t number, float& image) {
    const Piece& piece = pieces[number];
    const float free = image_of(bound * scale - piece.shift);
    image = free < piece.low ? piece.low : free > piece.high ? piece.high : free;
    error = std::max(error, std::abs((static_cast<double>(image) + piece.shift) * inverse - bound));
    if (is_window(number)) [[unlikely]]
      found |= image == free ? away : away | outside;
  };
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const double lower = boxes[k].lower[axis];
    const double upper = boxes[k].upper[axis];
    const std::size_t piece = piece_of(lower * scale);
    convert(lower, piece, out[k].lower[axis]);
    convert(upper, upper * scale < thresholds[piece] ? piece : piece_of(upper * scale), out[k].upper[axis]);
  }
  return found | (error > 0 ? 1U << axis : 0);
}

/// @param bounds Those in windows, scaled, ascending.
[[gnu::noinline]] void CoordinateMap::Axis::follow(std::span<const double> bounds) noexcept {
  for (std::span<const double> rest = bounds; !rest.empty();) {
    const std::size_t piece = piece_of(rest.front());
    const auto end = std::ranges::lower_bound(rest, thresholds[piece]);
    const auto inside = rest.first(static_cast<std::size_t>(end - rest.begin()));
    rest = rest.subspan(inside.size());
    auto& [shift, low, high] = pieces[piece];
    if (image_of(inside.front() - shift) >= low && image_of(inside.back() - shift) <= high) continue;
    const double length = static_cast<double>(high) - static_cast<double>(low);
    const bool fits = inside.back() - inside.front() <= length - unit;
    const double centre = fits ? inside.front() / 2 + inside.back() / 2 : inside[inside.size() / 2];
    shift = std::nearbyint((centre - static_cast<double>(low) - length / 2) / unit) * unit;
  }
}

auto CoordinateMap::shift_along(std::size_t axis) const noexcept -> Shift {
  const Axis& along = axes_.at(axis);
  const double shift = along.pieces[along.pieces.size() / 2].shift;
  return {along.limit, shift, error_of(shift)};
}

double CoordinateMap::least_original(std::size_t axis, float image) const noexcept {
  const Axis& along = axes_.at(axis);
  const auto piece = std::ranges::lower_bound(along.pieces, image, {}, &Piece::high);
  const auto number = static_cast<std::size_t>(piece - along.pieces.begin());
  if (image <= piece->low) return number == 0 ? -infinite : along.thresholds[number - 1] * along.inverse;
  const auto scaled = static_cast<double>(image);
  return (scaled - (std::abs(scaled) * relative_error + error_of(piece->shift)) + piece->shift) *
         along.inverse;
}

double CoordinateMap::greatest_original(std::size_t axis, float image) const noexcept {
  const Axis& along = axes_.at(axis);
  const auto next = std::ranges::upper_bound(along.pieces, image, {}, &Piece::low);
  const auto piece = next - 1;
  const auto number = static_cast<std::size_t>(piece - along.pieces.begin());
  if (image >= piece->high)
    return next == along.pieces.end() ? infinite : along.thresholds[number] * along.inverse;
  const auto scaled = static_cast<double>(image);
  return (scaled + (std::abs(scaled) * relative_error + error_of(piece->shift)) + piece->shift) *
         along.inverse;
}

CoordinateMap::CoordinateMap(std::size_t boxes, const ReadBoxes& read, bool keeps_distances,
                             const Threads& all) {
  const Threads threads = threads_of(boxes, all);
  const auto for_all = [&](const auto& function) {
    for_each_part(boxes, threads, [&](std::size_t begin, std::size_t end, std::size_t thread) {
      const DefaultFloatingPoint as_everywhere;
      std::array<Aabb64, 64> some;
      for (std::size_t first = begin; first < end; first += some.size()) {
        const auto out = std::span(some).first(std::min(some.size(), end - first));
        read(first, out);
        function(first, std::span<const Aabb64>(out), thread);
      }
    });
  };
  std::vector<std::array<Survey, 3>> surveys(threads.most);
  for_all([&](std::size_t /*first*/, std::span<const Aabb64> some, std::size_t thread) {
    for (std::size_t axis = 0; axis < axes_.size(); ++axis) surveys[thread][axis].add(axis, some);
  });
  std::array<std::vector<double>, 3> bounds;  // of axes with gaps to cut
  const DefaultFloatingPoint as_everywhere;
  for (std::size_t axis = 0; axis < axes_.size(); ++axis) {
    for (std::size_t k = 1; k < threads.most; ++k) surveys[0][axis].add(surveys[k][axis]);
    axes_[axis] = Axis(surveys[0][axis], boxes, keeps_distances);
    if (!axes_[axis].is_fine() && !keeps_distances) bounds[axis].resize(2 * boxes);
  }
  if (keeps_distances || std::ranges::all_of(axes_, &Axis::is_fine)) return;
  for_all([&](std::size_t first, std::span<const Aabb64> some, std::size_t /*thread*/) {
    for (std::size_t axis = 0; axis < axes_.size(); ++axis) {
      if (bounds[axis].empty()) continue;
      for (std::size_t k = 0; k < some.size(); ++k) {
        bounds[axis][2 * (first + k)] = some[k].lower[axis];
        bounds[axis][2 * (first + k) + 1] = some[k].upper[axis];
      }
    }
  });
  parallel_for(axes_.size(), threads, [&](std::size_t axis, std::size_t /*thread*/) {
    const DefaultFloatingPoint also_here;
    axes_[axis].cut(bounds[axis]);
  });
}

unsigned CoordinateMap::convert(std::span<const Aabb64> boxes, std::span<Aabb> out) const noexcept {
  const DefaultFloatingPoint as_everywhere;
  unsigned found = 0;
  for (std::size_t axis = 0; axis < axes_.size(); ++axis) found |= axes_[axis].convert(axis, boxes, out);
  return found;
}

/// Those of their bounds that are in windows, scaled, ascending.
[[gnu::noinline]] std::vector<double> CoordinateMap::Axis::in_windows(std::size_t axis,
                                                                      std::span<const Aabb64> boxes) const {
  std::vector<double> bounds;
  if (pieces.size() == 1) return bounds;  // about no boxes
  for (const Aabb64& box : boxes) {
    for (const double bound : {box.lower[axis], box.upper[axis]}) {
      if (is_window(piece_of(bound * scale))) bounds.push_back(bound * scale);
    }
  }
  std::ranges::sort(bounds);
  return bounds;
}

void CoordinateMap::follow(std::span<const Aabb64> boxes) {
  const DefaultFloatingPoint as_everywhere;
  std::array<std::vector<double>, 3> bounds;
  for (std::size_t axis = 0; axis < axes_.size(); ++axis) bounds[axis] = axes_[axis].in_windows(axis, boxes);
  // Nothing below throws.
  for (std::size_t axis = 0; axis < axes_.size(); ++axis) axes_[axis].follow(bounds[axis]);
}

bool CoordinateMap::halves(const CoordinateMap& other) const noexcept {
  for (std::size_t axis = 0; axis < axes_.size(); ++axis) {
    if (other.axes_[axis].extent >= 2 * axes_[axis].extent) return true;
  }
  return false;
}

}  // namespace broadcl
