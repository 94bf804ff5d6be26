#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>

namespace broadcl {

/// How boxes in double precision are searched in single precision: about a place near them.
///
/// A bound x becomes float(x - place), or 0 if that is denormal, lower and upper bounds alike. That never
/// decreases where x increases, so boxes that overlap still do, and two bounds that differ afterwards have
/// kept their order. Hence only pairs that touch in single precision, that is, have a bound in common, are in
/// doubt, and are compared in double precision.
class Origin {
 public:
  /// 0.
  Origin() = default;

  /// On each axis the median of the samples, or 0 if that is as good, since many numbers are exact there.
  /// @param samples Some of the boxes; those that are empty or infinite do not count.
  /// @param is_flat Whether all boxes extend from 0 to 0 in z. They then all touch there, which is not in
  /// doubt: they get bounds in which no two touch.
  /// @throws std::bad_alloc
  Origin(std::span<const Aabb64> samples, bool is_flat);

  /// How badly float32 resolves some boxes about this origin: the sum of its steps, as parts of the boxes'
  /// extents.
  /// @throws std::bad_alloc
  [[nodiscard]] double badness(std::span<const Aabb64> samples) const;

  [[nodiscard]] bool is_flat() const noexcept { return is_flat_; }

  /// Boxes in single precision. Empty ones stay empty, and those with a NaN bound have one.
  /// @param out As many as boxes.
  void convert(std::span<const Aabb64> boxes, std::span<Aabb> out) const noexcept;
  [[nodiscard]] Aabb convert(const Aabb64& box) const noexcept {
    Aabb out;
    convert({&box, 1}, {&out, 1});
    return out;
  }

  friend bool operator==(const Origin&, const Origin&) = default;

 private:
  std::array<double, 3> place_{};
  bool is_flat_ = false;
};

/// How a BroadPhase64 reads boxes of a caller: it stores them, and converts them for the search.
struct Conversion {
  Origin origin;
  Aabb64* boxes;  ///< As many as the caller's; written by stream().
};

/// Some of n boxes, to choose an origin by.
/// @param box Called with numbers below n; returns the box with this number.
/// @throws std::bad_alloc
template <class Function>
[[nodiscard]] std::vector<Aabb64> sample(std::size_t n, const Function& box) {
  constexpr std::size_t most = 128;
  const std::size_t step = (n / most) | 1;  // odd, since every second box is often of a kind
  std::vector<Aabb64> samples;
  samples.reserve(n / step + 1);
  for (std::size_t k = 0; k < n; k += step) samples.push_back(box(k));
  return samples;
}

/// Whether a box has no point whose z is not 0.
[[nodiscard]] constexpr bool is_flat_or_empty(const Aabb64& box) noexcept {
  // (A processor may take denormal numbers for zeros.)
  const auto is_zero = [](double number) { return std::bit_cast<std::uint64_t>(number) << 1U == 0; };
  return (is_zero(box.lower[2]) && is_zero(box.upper[2])) || is_empty(box);
}

}  // namespace broadcl
