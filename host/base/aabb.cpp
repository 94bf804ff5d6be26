#include <broadcl/aabb.hpp>

#include <algorithm>
#include <bit>
#include <cstdint>

namespace broadcl {
namespace {

// Of float64 and of float32.
constexpr unsigned sign_place = 63;
constexpr unsigned digits64 = 52;
constexpr unsigned digits32 = 23;
constexpr std::uint64_t infinity64 = std::uint64_t{0x7ff} << digits64;
constexpr std::uint32_t infinity32 = std::uint32_t{0xff} << digits32;
/// The exponent of the smallest normal float32, as float64 stores it.
constexpr unsigned least_exponent = 1023 - 126;

/// Rounds to float32: away from zero, or towards it. Computes with integers, so that neither the rounding
/// mode matters nor whether the processor takes denormal numbers for zeros.
std::uint32_t round_magnitude(std::uint64_t magnitude, bool away) {
  const auto exponent = static_cast<unsigned>(magnitude >> digits64);
  unsigned shift = digits64 - digits32;
  std::uint64_t digits = magnitude - (std::uint64_t{least_exponent - 1} << digits64);
  if (exponent < least_exponent) [[unlikely]] {  // denormal, or zero
    constexpr std::uint64_t first_digit = std::uint64_t{1} << digits64;
    digits = exponent == 0 ? magnitude : first_digit | (magnitude & (first_digit - 1));
    shift = std::min(shift + least_exponent - exponent, sign_place);
  }
  const std::uint64_t rounded = digits >> shift;
  const bool is_inexact = rounded << shift != digits;
  const bool steps = away && is_inexact;
  if (rounded >= infinity32) [[unlikely]] {
    if (magnitude > infinity64) return infinity32 | 1U << (digits32 - 1);  // a NaN
    return magnitude == infinity64 || away ? infinity32 : infinity32 - 1;
  }
  return static_cast<std::uint32_t>(rounded) + std::uint32_t{steps};
}

float round(double value, bool up) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  const bool is_negative = bits >> sign_place != 0;
  const std::uint64_t magnitude = bits & ((std::uint64_t{1} << sign_place) - 1);
  const auto sign = static_cast<std::uint32_t>(bits >> 32U) & 0x80000000U;
  return std::bit_cast<float>(round_magnitude(magnitude, up != is_negative) | sign);
}

float round_down(double value) {
  return round(value, false);
}

float round_up(double value) {
  return round(value, true);
}

}  // namespace

Aabb round_outward(const std::array<double, 3>& lower, const std::array<double, 3>& upper) noexcept {
  return {{round_down(lower[0]), round_down(lower[1]), round_down(lower[2])},
          {round_up(upper[0]), round_up(upper[1]), round_up(upper[2])}};
}

}  // namespace broadcl
