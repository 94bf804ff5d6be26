#pragma once

#include <bit>
#include <cstdint>

namespace broadcl {

/// The same number, also if the processor takes denormal numbers for zeros.
[[nodiscard]] constexpr double to_double(float number) noexcept {
  const auto bits = std::bit_cast<std::uint32_t>(number);
  if ((bits & 0x7f800000U) != 0) return static_cast<double>(number);
  const double magnitude = static_cast<double>(bits & 0x007fffffU) * 0x1p-149;
  return bits >> 31U != 0 ? -magnitude : magnitude;
}
[[nodiscard]] constexpr double to_double(double number) noexcept {
  return number;
}

}  // namespace broadcl
