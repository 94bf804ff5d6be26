#include <broadcl/aabb.hpp>

#include <bit>
#include <cstdint>

namespace broadcl {
namespace {

/// Uses arithmetic on the bits instead of std::nextafter and branches, which are mispredicted for random
/// numbers.
float round_down(double value) {
  const auto nearest = static_cast<float>(value);
  if (nearest == 0 && value < 0) return -std::numeric_limits<float>::denorm_min();
  const auto bits = std::bit_cast<std::int32_t>(nearest);
  const std::int32_t step = bits < 0 ? 1 : -1;  // to the next number below, for either sign
  return std::bit_cast<float>(bits + step * std::int32_t{static_cast<double>(nearest) > value});
}

float round_up(double value) {
  return -round_down(-value);
}

}  // namespace

Aabb round_outward(const std::array<double, 3>& lower, const std::array<double, 3>& upper) noexcept {
  return {{round_down(lower[0]), round_down(lower[1]), round_down(lower[2])},
          {round_up(upper[0]), round_up(upper[1]), round_up(upper[2])}};
}

}  // namespace broadcl
