#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include <broadcl/aabb.hpp>

namespace broadcl::mpi {

using Point = std::array<float, 3>;

/// A point that represents the work around it.
struct Sample {
  Point point;
  float weight;
};

/// Space, divided into regions by recursive bisection: for each cut, points below it belong to the lower half
/// of the regions, all others to the upper half. So every point, including infinite ones, is in exactly one
/// region.
class Cuts {
 public:
  /// @param regions At least 1.
  /// @param sample Modified. Where there are no samples, cuts are arbitrary.
  Cuts(std::size_t regions, std::vector<Sample> sample);

  [[nodiscard]] std::size_t region_of(const Point& point) const noexcept;

  /// Calls function(region) for each region that a box touches, in ascending order. These are the regions
  /// that may contain the componentwise maximum of its lower corner and that of an overlapping box.
  /// @param box Neither empty nor with a NaN.
  template <class Function>
  void for_each_touched(const Aabb& box, const Function& function) const {
    touch(0, regions_, box, function);
  }

  /// A region: the points p with lower <= p < upper on each axis; an upper bound of infinity is no limit.
  struct Bounds {
    Point lower;
    Point upper;

    /// Whether a box touches no other region.
    [[nodiscard]] bool enclose(const Aabb& box) const noexcept {
      bool encloses = true;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const bool has_end = upper[axis] < std::numeric_limits<float>::infinity();
        encloses &= lower[axis] <= box.lower[axis] && (!has_end || box.upper[axis] < upper[axis]);
      }
      return encloses;
    }
  };
  [[nodiscard]] Bounds bounds(std::size_t region) const noexcept;

 private:
  struct Cut {
    std::uint32_t axis;
    float at;
  };

  template <class Function>
  void touch(std::size_t first, std::size_t count, const Aabb& box, const Function& function) const {
    if (count == 1) {
      function(first);
      return;
    }
    const std::size_t middle = first + count / 2;
    const Cut& cut = cuts_[middle];
    if (box.lower[cut.axis] < cut.at) touch(first, middle - first, box, function);
    if (box.upper[cut.axis] >= cut.at) touch(middle, first + count - middle, box, function);
  }

  void bisect(std::size_t first, std::size_t count, Sample* begin, Sample* end);

  std::size_t regions_;
  std::vector<Cut> cuts_;  // by the first region of the upper half
};

}  // namespace broadcl::mpi
