#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>

#include "base/threads.hpp"

namespace broadcl {

/// Reads as many boxes as `out` has, from `first` on; an empty box as six NaNs. Several threads call it.
using ReadBoxes = std::function<void(std::size_t first, std::span<Aabb64> out)>;

/// How boxes in double precision are searched in single precision: each bound is replaced by its image, and
/// on each axis the image is a non-decreasing function of the bound, lower and upper bounds alike. So boxes
/// that overlap still do, and bounds whose images differ have kept their order. Hence only pairs that touch
/// in single precision, that is, have a bound in common, are in doubt, and are compared in double precision.
///
/// Intervals in which bounds are have images side by side, about 0: one interval if float32 resolves that
/// well enough, otherwise several, and the gaps between them are cut out. What remains of gaps, and beyond
/// the first and the last interval, are windows, which follow boxes on their way from one interval to
/// another.
class CoordinateMap {
 public:
  /// What convert() finds, as bits.
  enum : unsigned {
    in_doubt = 7,  ///< A bit per axis: a bound does not follow from its image, so others may share it.
    away = 8,      ///< A finite bound is in no interval.
    outside = 16   ///< Nor is it in a window: it has the image of the window's end.
  };

  /// Each bound is rounded.
  CoordinateMap() = default;

  /// For some boxes, of which none is away then.
  /// @param keeps_distances Whether all bounds of an axis are only moved by the same number, and rounded.
  /// None is ever away then, and image_error() is how inexact images are.
  /// @param threads At most.
  /// @throws std::bad_alloc
  CoordinateMap(std::size_t boxes, const ReadBoxes& read, bool keeps_distances, const Threads& threads);

  /// Whether it was made for boxes of which some has a finite bound.
  [[nodiscard]] bool is_made() const noexcept {
    return std::ranges::any_of(axes_, [](const Axis& axis) { return axis.pieces.size() > 1; });
  }

  /// Images, which are neither -0 nor denormal; infinity stays infinity, and NaN stays NaN.
  /// @param boxes Each has its bounds in order, or is six NaNs.
  /// @param out As many as boxes.
  /// @return The bits of all boxes together.
  [[nodiscard]] unsigned convert(std::span<const Aabb64> boxes, std::span<Aabb> out) const noexcept;

  /// How the images of an axis that are up to a limit are moved back.
  struct Shift {
    double limit;  ///< 0 if there are none.
    double shift;
    double error;  ///< What is moved back is at most so far from the original, and `relative_error` of the
                   ///< image.
  };
  static constexpr double relative_error = 0x1p-22;
  [[nodiscard]] Shift shift_along(std::size_t axis) const noexcept;

  /// Bounds between which all bounds are whose images are between two others.
  [[nodiscard]] double least_original(std::size_t axis, float image) const noexcept;
  [[nodiscard]] double greatest_original(std::size_t axis, float image) const noexcept;

  /// Moves windows in whose gaps boxes are outside to these. Images of boxes that are not away stay the same.
  /// @param boxes All that are away.
  /// @throws std::bad_alloc; then nothing has changed.
  void follow(std::span<const Aabb64> boxes);

  /// Whether on some axis the images of another map extend at least twice as far.
  [[nodiscard]] bool halves(const CoordinateMap& other) const noexcept;

 private:
  /// What is to be known of all boxes on an axis.
  struct Survey {
    std::array<double, 2> range{std::numeric_limits<double>::infinity(),
                                -std::numeric_limits<double>::infinity()};  ///< Of finite bounds.
    std::array<std::uint32_t, 2048> sizes{};  ///< How many boxes with finite bounds, by the exponent.

    void add(std::size_t axis, std::span<const Aabb64> boxes) noexcept;
    void add(const Survey& other) noexcept;
  };

  /// An interval or a window: the image of x is x * scale - shift, clamped to low and high.
  struct Piece {
    double shift = 0;
    float low = -std::numeric_limits<float>::infinity();
    float high = std::numeric_limits<float>::infinity();
  };
  struct Axis {
    Axis() = default;
    /// One interval.
    Axis(const Survey& survey, std::size_t boxes, bool keeps_distances);
    /// Cuts gaps out until float32 resolves it well, or that does not help any more.
    /// @param bounds The lower and the upper one of each box.
    void cut(std::span<const double> bounds);
    [[nodiscard]] bool is_fine() const noexcept;
    /// For intervals of bounds in ascending order.
    Axis(const std::vector<std::array<double, 2>>& intervals, double least);

    [[nodiscard]] std::size_t piece_of(double scaled) const noexcept;
    [[nodiscard]] std::size_t bucket_of(double scaled) const noexcept;
    [[nodiscard]] unsigned convert(std::size_t axis, std::span<const Aabb64> boxes,
                                   std::span<Aabb> out) const noexcept;
    [[nodiscard]] unsigned convert_by_piece(std::size_t axis, std::span<const Aabb64> boxes,
                                            std::span<Aabb> out) const noexcept;
    [[nodiscard]] std::vector<double> in_windows(std::size_t axis, std::span<const Aabb64> boxes) const;
    void follow(std::span<const double> bounds) noexcept;

    double scale = 1, inverse = 1;                            ///< Powers of two.
    double extent = std::numeric_limits<double>::infinity();  ///< How far from 0 images are.
    double limit = extent;                                    ///< Images up to this are in the only interval.
    double size = 0;                                          ///< Of nearly all boxes, at least.
    double unit = 0;                                          ///< Of shifts, so that grids stay grids.
    std::vector<Piece> pieces{{}};      ///< What is infinite, a window, an interval, ..., a window, infinite.
    std::vector<double> thresholds;     ///< Where all pieces but the first begin; then NaN.
    std::vector<std::uint16_t> before;  ///< Buckets of thresholds: how many are in those before.
    double first = 0, per_unit = 0, last = 0;  ///< Buckets.
  };

  std::array<Axis, 3> axes_;
};

}  // namespace broadcl
