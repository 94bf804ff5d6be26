#include <broadcl/box_view.hpp>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>

#include <broadcl/error.hpp>

#include "base/lanes.hpp"

namespace broadcl {
namespace {

using BoundPointers = std::array<const std::byte*, 6>;

/// The same number, also if the processor takes denormal numbers for zeros.
double to_double(float number) noexcept {
  const auto bits = std::bit_cast<std::uint32_t>(number);
  if ((bits & 0x7f800000U) != 0) return static_cast<double>(number);
  const double magnitude = static_cast<double>(bits & 0x007fffffU) * 0x1p-149;
  return bits >> 31U != 0 ? -magnitude : magnitude;
}
double to_double(double number) noexcept {
  return number;
}

template <class S>
Aabb64 to_aabb64(const std::array<S, 3>& lower, const std::array<S, 3>& upper) noexcept {
  return {{to_double(lower[0]), to_double(lower[1]), to_double(lower[2])},
          {to_double(upper[0]), to_double(upper[1]), to_double(upper[2])}};
}

/// Whether a lower bound exceeds the upper one, but not as in empty_aabb().
template <class S>
bool is_inverted(S lower, S upper) noexcept {
  constexpr S infinity = std::numeric_limits<S>::infinity();
  return lower > upper && !(lower == infinity && upper == -infinity);
}

template <class S>
bool is_inverted(const std::array<S, 3>& lower, const std::array<S, 3>& upper) noexcept {
  return is_inverted(lower[0], upper[0]) || is_inverted(lower[1], upper[1]) ||
         is_inverted(lower[2], upper[2]);
}

/// The layout of boxes of which so many are inverted, if their numbers are not what the view says.
template <class Boxes>
BoxLayout likely_layout(const Boxes& boxes, std::size_t size, std::size_t inverted) noexcept {
  constexpr std::size_t dimensions = Boxes::dimensions;
  bool are_axes = true;
  bool are_centres = inverted > size / 2;
  for (std::size_t k = 0; k < size && (are_axes || are_centres); ++k) {
    const auto [lower, upper] = boxes.corners(k);
    const auto number = [&lower = lower, &upper = upper](std::size_t index) {
      return index < dimensions ? lower[index] : upper[index - dimensions];
    };
    for (std::size_t axis = 0; axis < dimensions; ++axis) {
      are_axes = are_axes && !is_inverted(number(2 * axis), number(2 * axis + 1));
      are_centres = are_centres && upper[axis] >= 0;
    }
  }
  if (are_axes) return BoxLayout::axes;
  return are_centres ? BoxLayout::centre_size : BoxLayout::min_max;
}

/// Boxes in the layout of an array of Aabb.
struct Packed {
  static constexpr std::size_t dimensions = 3;

  const std::byte* boxes;

  Aabb operator[](std::size_t k) const noexcept {
    Aabb box;
    std::memcpy(&box, boxes + k * sizeof(Aabb), sizeof(Aabb));
    return box;
  }

  [[nodiscard]] Aabb corners(std::size_t k) const noexcept { return (*this)[k]; }

  [[nodiscard]] Aabb64 exact(std::size_t k) const noexcept {
    const Aabb box = (*this)[k];
    return to_aabb64(box.lower, box.upper);
  }

  /// Whether no lower bound exceeds the upper one. (A vector has x of the next box or of the upper corner,
  /// too.)
  [[nodiscard]] bool are_ordered(std::size_t begin, std::size_t end) const noexcept {
    auto any = FourLanes{} > FourLanes{};
    for (std::size_t k = begin; k < end; ++k) {
      FourLanes lower;
      FourLanes upper;
      std::memcpy(&lower, boxes + k * sizeof(Aabb), sizeof lower);
      std::memcpy(&upper, boxes + k * sizeof(Aabb) + offsetof(Aabb, upper), sizeof upper);
      any |= lower > upper;
    }
    return (any[0] | any[1] | any[2]) == 0;
  }
};

/// Boxes in any other layout.
template <class S, std::size_t number_of_dimensions>
struct Strided {
  static constexpr std::size_t dimensions = number_of_dimensions;

  BoundPointers bounds;
  std::ptrdiff_t stride;

  struct Corners {
    std::array<S, 3> lower, upper;
  };

  [[nodiscard]] Corners corners(std::size_t k) const noexcept {
    const std::ptrdiff_t offset = static_cast<std::ptrdiff_t>(k) * stride;
    const auto bound = [&](std::size_t index) {
      S value;
      std::memcpy(&value, bounds[index] + offset, sizeof(S));
      return value;
    };
    Corners corners{{bound(0), bound(1)}, {bound(3), bound(4)}};
    if constexpr (dimensions > 2) {
      corners.lower[2] = bound(2);
      corners.upper[2] = bound(5);
    }
    return corners;
  }

  [[nodiscard]] Aabb64 exact(std::size_t k) const noexcept {
    const auto [lower, upper] = corners(k);
    return to_aabb64(lower, upper);
  }

  Aabb operator[](std::size_t k) const noexcept {
    const auto [lower, upper] = corners(k);
    if constexpr (std::same_as<S, float>) {
      return {lower, upper};
    } else if (lower[0] > upper[0] || lower[1] > upper[1] || lower[2] > upper[2]) {
      // If it were rounded outward, a box that is inverted by less than the resolution of float32 would no
      // longer be empty.
      const Aabb inward = round_outward(upper, lower);
      return {inward.upper, inward.lower};
    } else {
      return round_outward(lower, upper);
    }
  }
};

}  // namespace

void BoxView::check(const void* pointer, std::size_t alignment, std::size_t n, std::ptrdiff_t stride) {
  const auto refuse = [n](const std::string& why) {
    throw Error::invalid_argument("a view of " + std::to_string(n) + " boxes " + why);
  };
  if (pointer == nullptr) refuse("has a null pointer; give 0 boxes if there are none");
  if (reinterpret_cast<std::uintptr_t>(pointer) % alignment != 0) {
    refuse("has a pointer that is not a multiple of " + std::to_string(alignment) +
           " bytes; copy the boxes to aligned memory");
  }
  if (stride % static_cast<std::ptrdiff_t>(alignment) != 0) {
    refuse("has a stride of " + std::to_string(stride) + " bytes, which is not a multiple of " +
           std::to_string(alignment) + "; give the bytes from one box to the next, or copy the boxes");
  }
  // Neither the boxes nor a copy of them may be larger than the largest pointer difference.
  const std::size_t distance =
      stride < 0 ? std::size_t{0} - static_cast<std::size_t>(stride) : static_cast<std::size_t>(stride);
  if (n > std::numeric_limits<std::ptrdiff_t>::max() / std::max(distance, sizeof(Aabb))) {
    refuse("with a stride of " + std::to_string(stride) +
           " bytes is larger than memory; give the number of boxes, and the stride in bytes");
  }
}

template <class Function>
auto BoxView::with_layout(const Function& function) const {
  if (are_rectangles()) {
    if (is_double_) return function(Strided<double, 2>{bounds_, stride_});
    return function(Strided<float, 2>{bounds_, stride_});
  }
  if (is_double_) return function(Strided<double, 3>{bounds_, stride_});
  return boxes(false) != nullptr ? function(Packed{bounds_[0]})
                                 : function(Strided<float, 3>{bounds_, stride_});
}

const void* BoxView::boxes(bool in_double) const noexcept {
  if (bounds_[2] == nullptr) return nullptr;
  const std::ptrdiff_t size = in_double ? sizeof(double) : sizeof(float);
  bool is_packed = is_double_ == in_double && stride_ == std::ssize(bounds_) * size;
  for (std::size_t index = 1; index < bounds_.size(); ++index) {
    is_packed = is_packed && bounds_[index] == bounds_[index - 1] + size;
  }
  return is_packed ? bounds_[0] : nullptr;
}

Aabb BoxView::operator[](std::size_t k) const noexcept {
  return with_layout([k](const auto& boxes) { return boxes[k]; });
}

Aabb64 BoxView::exact(std::size_t k) const noexcept {
  return with_layout([k](const auto& boxes) { return boxes.exact(k); });
}

InvertedBoxes BoxView::inverted() const noexcept {
  return with_layout([this](const auto& boxes) {
    InvertedBoxes found;
    constexpr std::size_t block = 32;
    for (std::size_t begin = 0; begin < size_; begin += block) {
      const std::size_t end = std::min(size_, begin + block);
      if constexpr (std::same_as<std::remove_cvref_t<decltype(boxes)>, Packed>) {
        if (end < size_ && boxes.are_ordered(begin, end)) continue;
      }
      for (std::size_t k = begin; k < end; ++k) {
        const auto [lower, upper] = boxes.corners(k);
        if (is_inverted(lower, upper) && found.count++ == 0) found.first = k;
      }
    }
    if (found.count > 0) found.likely = likely_layout(boxes, size_, found.count);
    return found;
  });
}

template <class Box>
void BoxView::read(std::size_t first, std::span<Box> out) const noexcept {
  with_layout([&](const auto& boxes) {
    for (std::size_t k = 0; k < out.size(); ++k) {
      if constexpr (std::same_as<Box, Aabb>) {
        out[k] = boxes[first + k];
      } else {
        out[k] = boxes.exact(first + k);
      }
    }
  });
}
template void BoxView::read(std::size_t first, std::span<Aabb> out) const noexcept;
template void BoxView::read(std::size_t first, std::span<Aabb64> out) const noexcept;

void BoxView::copy_to(std::span<Aabb> out) const {
  if (out.size() < size_) {
    throw Error::invalid_argument(std::to_string(size_) + " boxes do not fit into memory for " +
                                  std::to_string(out.size()) + "; give memory for all boxes of the view");
  }
  read(0, out.first(size_));
}

}  // namespace broadcl
